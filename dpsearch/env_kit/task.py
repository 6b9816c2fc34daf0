"""A task, which Gymnasium classes with a kernel play: its dynamics and spaces, and what it tells Gymnasium."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from dpsearch.kernels.lanes import EnvKernel


@dataclass(frozen=True, kw_only=True)
class Task:
    """The description of an environment with a kernel.

    Attributes:
        kernel: The compiled dynamics.
        observation_space: Space of observations, a flat box of float32.
        action_space: Space of actions: ``Discrete``, counting from 0, or a flat ``Box``. The kernel clips actions
            that lie beyond the bounds of the box.
        state_space: Space of the hidden state, which ``info["state"]`` holds. If it is ``Discrete``, that is the number
            in row 0 of the kernel's state; if it is a ``Box``, the whole state.
        max_episode_steps: Steps after which an episode is cut off, at least 1.
        reward_threshold: Mean return that counts as solved, if there is one; see also :meth:`threshold`.

    Raises:
        ValueError: If ``max_episode_steps`` is below 1.
    """

    kernel: EnvKernel
    observation_space: spaces.Box
    action_space: spaces.Discrete | spaces.Box
    state_space: spaces.Discrete | spaces.Box
    max_episode_steps: int
    reward_threshold: float | None = None

    def __post_init__(self) -> None:
        if self.max_episode_steps < 1:
            raise ValueError(f"max_episode_steps must be at least 1, got {self.max_episode_steps}")

    @property
    def mirror_signs(self) -> tuple[float, ...] | None:
        """The signs by which a mirror multiplies observations and actions (``symmetry.py``); None without symmetry."""
        return None

    def threshold(self, limit: int) -> float | None:
        """Mean return that counts as solved if episodes last up to ``limit`` steps; None if none does."""
        return self.reward_threshold

    def hidden(self, states: NDArray[np.float64]) -> NDArray[Any]:
        """The hidden states, as in ``state_space``, that belong to states of the kernel ``(n, state size)``."""
        return states[:, 0].astype(np.int64) if isinstance(self.state_space, spaces.Discrete) else states

    def details(self, states: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
        """Entries of ``info`` besides the hidden state, ``(n,)`` each, for states of the kernel ``(n, state size)``."""
        return {}

    def carry_on(self, states: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
        """Options ``(n,)`` for ``reset`` to go on from the last states ``(n, state size)``; none by default."""
        return {}

    def check_actions(self, actions: Any, shape: tuple[int, ...]) -> NDArray[Any]:
        """The actions as an array.

        Raises:
            ValueError: If the shape is wrong, a discrete action is not in the space, or a number is not
                finite.
        """
        array = np.asarray(actions)
        if array.shape != shape:
            raise ValueError(f"actions must have shape {shape}, got {array.shape}")
        if isinstance(self.action_space, spaces.Discrete):
            good = array.dtype.kind in "iu" and ((array >= 0) & (array < self.action_space.n)).all()
        else:
            good = array.dtype.kind in "iuf" and np.isfinite(array).all()
        if not good:
            raise ValueError(f"an action must be in {self.action_space}, got {actions!r}")
        return array


class PlaysTask:
    """Properties that scalar and vector classes share; they come from the task.

    Attributes:
        task: The task that is played.
    """

    task: Task
    _spec: EnvSpec | None = None

    @property
    def kernel(self) -> EnvKernel:
        """The compiled dynamics."""
        return self.task.kernel

    @property
    def max_episode_steps(self) -> int:
        """Steps after which an episode is cut off."""
        return self.task.max_episode_steps

    @property
    def reward_threshold(self) -> float | None:
        """Mean return that counts as solved, if there is one."""
        return self.task.threshold(self.max_episode_steps)

    @property
    def mirror_signs(self) -> tuple[float, ...] | None:
        """The signs by which a mirror multiplies observations and actions; None for no symmetry."""
        return self.task.mirror_signs

    @property
    def spec(self) -> EnvSpec | None:
        """Gymnasium's spec, with this task's own limit and threshold: the registered ones do not know its arguments."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None:
            limit = self.max_episode_steps if spec.max_episode_steps is None else spec.max_episode_steps
            threshold = self.task.threshold(min(limit, self.max_episode_steps))
            spec = replace(spec, max_episode_steps=limit, reward_threshold=threshold)
        self._spec = spec
