"""Each episode is also learned from as its mirror image, for tasks that are alike on the left and on the right.

A car that gained by being pushed to the left by its noise would, on the mirrored road, have gained as much by the same
push to the right. An agent that knows this learns from both, and need not wait for a curve to the right.

The two together are the gradient of a policy made symmetric, (mu(h) + M mu(M h)) / 2 with M for the mirror. Asymmetry
that is already in the policy stays, so start from small weights.

The environment declares M in its attribute ``mirror_signs``: 1 or -1 for each number of the flat observation, then for
each of the action, by which a mirror multiplies it. A speed is the same in a mirror, 1; what points to a side turns
around, -1. An environment in which numbers change places in a mirror, as rays to both sides do, declares none.
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
    """Doubles episodes, and carries along the memory that the policy would have of a mirrored stream.

    Args:
        signs: The environment's ``mirror_signs``; None if it declares none.
        policy: The policy that acts.

    Raises:
        ValueError: If there are no signs, or they do not fit, or the policy is not Gaussian.
    """

    def __init__(self, signs: Sequence[float] | None, policy: RecurrentPolicy) -> None:
        seen, done = policy.observation_size, policy.head.action_size
        if not isinstance(policy.head, Gaussian):
            raise ValueError("mirror must be false: it needs a Gaussian policy, for actions that are a Box")
        if signs is None:
            raise ValueError("mirror must be false: this environment declares no mirror_signs")
        numbers = np.asarray(signs, np.float32)
        if numbers.shape != (seen + done,) or (np.abs(numbers) != 1.0).any():
            raise ValueError(
                f"mirror must be false: this environment's mirror_signs are not a 1 or -1 for each of {seen} numbers "
                f"observed and {done} of an action, but {signs}"
            )
        self._policy = policy
        self._seen, self._done = numbers[:seen], numbers[seen:]
        self._outputs = torch.tensor([*numbers[seen:].tolist(), *[1.0] * done])  # means change sides, deviations do not
        self._memory = torch.zeros(policy.state_size)  # at the end of the last mirrored piece

    def doubled(self, episodes: Episodes) -> Episodes:
        """N episodes, or pieces of a stream, followed by their mirror images: 2 N columns."""
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
        """Recurrent state before the first step of each mirrored piece, ``(N, state_size)``."""
        memories = torch.zeros(pieces.memory.shape)
        if not pieces.begins:
            memories[0] = self._memory
        steps = int(pieces.lengths[-1])
        with torch.no_grad():
            last = torch.from_numpy(observations[:steps, -1:]), torch.from_numpy(actions[:steps, -1:])
            self._memory = self._policy(last[0], memories[-1:], last[1])[1][0]
        return memories.numpy()

    def reflect(self, eligibilities: Tensor) -> None:
        """Replace the images' eligibilities by the mirrored ones of the episodes: ``(T, 2 N, K)``, in place.

        The policy did not draw the images' actions. The noise in the actions made the difference, and that is mirrored
        here: where task and policy are symmetric, this is the images' gradient.
        """
        n = eligibilities.shape[1] // 2
        eligibilities[:, n:] = eligibilities[:, :n] * self._outputs

    def state_dict(self) -> dict[str, Any]:
        """Everything that later images depend on."""
        return {"memory": self._memory}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from where ``state_dict`` was taken."""
        self._memory = state["memory"]
