"""Acting in many environments step by step, with a memory for each: for use, where engines are for learning."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from dpsearch.policies.policy import RecurrentPolicy


class PolicyRunner:
    """Acts in B environments with one policy and keeps the recurrent state of each.

    The policy is not copied: the runner acts by its present weights.

    Args:
        policy: The policy that chooses the actions.
        num_envs: B, the number of environments.
        seed: Seed of the action noise.
        greedy: Take the most probable action instead of a random one.

    Raises:
        ValueError: If ``num_envs`` is below 1.
    """

    def __init__(self, policy: RecurrentPolicy, num_envs: int = 1, *, seed: int = 0, greedy: bool = False) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, got {num_envs}")
        self.policy = policy
        self.num_envs = num_envs
        self.greedy = greedy
        self._rng = np.random.default_rng(seed)
        self._state = torch.zeros(num_envs, policy.state_size)

    def act(self, observations: ArrayLike) -> NDArray[Any]:
        """Choose an action in every environment, and go on by one step.

        Args:
            observations: ``(B, O)``, flat.

        Returns:
            Actions ``(B, action_size)``: whole numbers if discrete, else numbers of which [-1, 1] is the Box's range.

        Raises:
            ValueError: If the shape is wrong.
        """
        batch = np.asarray(observations, np.float32)
        if batch.shape != (self.num_envs, self.policy.observation_size):
            expected = (self.num_envs, self.policy.observation_size)
            raise ValueError(f"observations must have shape {expected}, got {batch.shape}")
        uniforms = None
        if not self.greedy:
            words = self._rng.integers(2**32, size=(self.num_envs, self.policy.head.draws))
            uniforms = torch.from_numpy((words + 0.5) * 2.0**-32)  # never 0 nor 1
        actions, self._state = self.policy.act(torch.from_numpy(batch), self._state, uniforms)
        return actions.numpy()

    def reset(self, mask: ArrayLike | None = None) -> None:
        """Set the recurrent state to zero where an episode begins.

        Args:
            mask: ``(B,)``, True where an episode begins; everywhere if None.

        Raises:
            ValueError: If the mask is not one truth value for each environment.
        """
        forget = np.ones(self.num_envs, np.bool_) if mask is None else np.asarray(mask)
        if forget.shape != (self.num_envs,) or forget.dtype != np.bool_:
            raise ValueError(f"mask must be {self.num_envs} truth values, got {forget.dtype} {forget.shape}")
        self._state[torch.from_numpy(forget)] = 0.0

    @property
    def state(self) -> NDArray[np.float32]:
        """A copy of the recurrent state, ``(B, state_size)``; assigning it sets the state."""
        return self._state.numpy().copy()

    @state.setter
    def state(self, state: ArrayLike) -> None:
        array = np.array(state, np.float32)
        if array.shape != tuple(self._state.shape):
            raise ValueError(f"state must have shape {tuple(self._state.shape)}, got {array.shape}")
        self._state = torch.from_numpy(array)
