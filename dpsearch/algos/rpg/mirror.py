"""Every episode once more, as a mirror shows it: for tasks that are alike on the left and on the right.

A car that is steered to the left by its noise, and is the better off for it, would have been by the same push to the
right on the mirrored road. Where that is known, an agent learns from both, and need not wait for a curve to the right.

The two together are the gradient of a policy made symmetric, (mu(h) + M mu(M h)) / 2 with M for the mirror. It says
nothing of how far the policy itself is from that: begin with small weights, as what is lopsided is not unlearned.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dpsearch.policies import Gaussian, RecurrentPolicy
from dpsearch.rollout import Episodes, Pieces


class Mirror:
    """Doubles episodes, and carries along what the policy would remember of a mirrored stream.

    Args:
        signs: 1 or -1 for each number of an observation and then of an action: by what a mirror multiplies it.
        policy: What acts; Gaussian.

    Raises:
        ValueError: If there are not as many signs, or others, or the policy is not Gaussian.
    """

    def __init__(self, signs: Sequence[float], policy: RecurrentPolicy) -> None:
        seen, done = policy.observation_size, policy.head.action_size
        if not isinstance(policy.head, Gaussian):
            raise ValueError("mirror needs a Gaussian policy, for actions that are a Box; null learns without images")
        if not isinstance(signs, Sequence) or len(signs) != seen + done or any(abs(sign) != 1.0 for sign in signs):
            raise ValueError(
                f"mirror must be a 1 or -1 for each of {seen} numbers observed and {done} of an action, or null, "
                f"got {signs}"
            )
        self._policy = policy
        self._seen, self._done = np.array(signs[:seen], np.float32), np.array(signs[seen:], np.float32)
        self._outputs = torch.tensor([*signs[seen:], *[1.0] * done])  # means, and deviations, which stay what they are
        self._memory = torch.zeros(policy.state_size)  # at the end of the last mirrored piece

    def doubled(self, episodes: Episodes) -> Episodes:
        """N episodes, or pieces of a stream, and behind them their mirror images, likewise: 2 N columns."""
        observations, actions = episodes.observations * self._seen, episodes.actions * self._done
        more: dict[str, NDArray[Any]] = {}
        if isinstance(episodes, Pieces):
            more["memory"] = np.concatenate((episodes.memory, self._memories(episodes, observations, actions)))
        return replace(
            episodes,
            observations=np.concatenate((episodes.observations, observations), 1),
            actions=np.concatenate((episodes.actions, actions), 1),
            rewards=np.concatenate((episodes.rewards,) * 2, 1),
            lengths=np.concatenate((episodes.lengths,) * 2),
            terminated=np.concatenate((episodes.terminated,) * 2),
            returns=np.concatenate((episodes.returns,) * 2),
            **more,
        )

    def _memories(
        self, pieces: Pieces, observations: NDArray[np.float32], actions: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """Before the first step of each mirrored piece, ``(N, state_size)``."""
        memories = torch.zeros(pieces.memory.shape)
        if not pieces.begins:
            memories[0] = self._memory
        steps = int(pieces.lengths[-1])
        with torch.no_grad():
            last = torch.from_numpy(observations[:steps, -1:]), torch.from_numpy(actions[:steps, -1:])
            self._memory = self._policy(last[0], memories[-1:], last[1])[1][0]
        return memories.numpy()

    def reflect(self, eligibilities: Tensor) -> None:
        """Put the eligibilities of N episodes ``(T, 2 N, K)``, mirrored, in the place of those of their images.

        Actions of the images were not drawn from what the policy would do there. What made the difference was the
        noise in them, and that is mirrored here: where task and policy are symmetric, this is the images' gradient.
        """
        n = eligibilities.shape[1] // 2
        eligibilities[:, n:] = eligibilities[:, :n] * self._outputs

    def state_dict(self) -> dict[str, Any]:
        """What the rest of a run depends on."""
        return {"memory": self._memory}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on where ``state_dict`` was taken."""
        self._memory = state["memory"]
