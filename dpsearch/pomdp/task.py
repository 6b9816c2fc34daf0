"""A finite POMDP as a task, which the Gymnasium classes of ``env_kit`` play."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from gymnasium import spaces
from typing_extensions import override

from dpsearch.env_kit.task import Task
from dpsearch.pomdp.kernel import tabular_kernel
from dpsearch.pomdp.model import TabularPOMDP


@dataclass(frozen=True, kw_only=True)
class TabularTask(Task):
    """The task of playing a finite POMDP.

    Attributes:
        pomdp: The model.
    """

    pomdp: TabularPOMDP

    @override
    def threshold(self, limit: int) -> float | None:
        """The task's own threshold; where episodes have no end of their own, in proportion to the steps they last."""
        if self.reward_threshold is None or self.pomdp.terminal.any():
            return self.reward_threshold
        return self.reward_threshold * limit / self.max_episode_steps


def tabular_task(pomdp: TabularPOMDP, max_episode_steps: int, reward_threshold: float | None = None) -> TabularTask:
    """A model as a task for :class:`KernelEnv` and :class:`KernelVectorEnv`.

    Args:
        pomdp: The model.
        max_episode_steps: Steps after which an episode is cut off.
        reward_threshold: Mean return that counts as solved; None if none does.
    """
    low, high = np.float32(pomdp.features.min()), np.float32(pomdp.features.max())
    return TabularTask(
        kernel=tabular_kernel(pomdp),
        observation_space=spaces.Box(low, high, pomdp.features.shape[1:], np.float32),
        action_space=spaces.Discrete(pomdp.n_actions),
        state_space=spaces.Discrete(pomdp.n_states),
        max_episode_steps=max_episode_steps,
        reward_threshold=reward_threshold,
        pomdp=pomdp,
    )
