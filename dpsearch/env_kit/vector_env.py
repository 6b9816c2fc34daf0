"""Gymnasium's vector class for any environment that has a kernel; ``env.py`` has the scalar class."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, Protocol

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from dpsearch.env_kit.env import random_key
from dpsearch.env_kit.stepper import LaneStepper
from dpsearch.env_kit.task import PlaysTask, Task


class KernelVectorEnv(PlaysTask, VectorEnv[NDArray[np.float32], NDArray[Any], NDArray[Any]]):
    """Many environments of one task, played by its kernel.

    Environment ``i`` of a vector that is seeded with the number ``s`` has seed ``s + i``.

    Args:
        task: The task to play.
        num_envs: Number of environments.
        autoreset_mode: When the next episode follows an ended one, ``NEXT_STEP`` or ``SAME_STEP``.
        render_mode: None, for vectors are not drawn.

    Attributes:
        task: The task that is played.

    Raises:
        ValueError: If an argument is not accepted.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    def __init__(
        self,
        task: Task,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
    ) -> None:
        if num_envs < 1:
            raise ValueError(f"num_envs must be at least 1, got {num_envs}")
        if render_mode is not None:
            raise ValueError('to draw a vector of environments, make it with vectorization_mode="sync"')
        self._same_step = AutoresetMode(autoreset_mode) == AutoresetMode.SAME_STEP
        if AutoresetMode(autoreset_mode) == AutoresetMode.DISABLED:
            raise ValueError("autoreset_mode must be NEXT_STEP or SAME_STEP, got DISABLED")
        self.metadata = {**self.metadata, "autoreset_mode": AutoresetMode(autoreset_mode)}
        self.task = task
        self.num_envs = num_envs
        self.single_observation_space = task.observation_space
        self.single_action_space = task.action_space
        self.observation_space = batch_space(task.observation_space, num_envs)
        self.action_space = batch_space(task.action_space, num_envs)
        self._stepper = LaneStepper(task.kernel, num_envs)
        self._everyone = np.ones(num_envs, np.bool_)
        self._started = np.zeros(num_envs, np.bool_)
        self._over = np.zeros(num_envs, np.bool_)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Starts episode 0 of the seeds, or the next episode where none is given.

        Args:
            seed: A seed for each environment, or a number ``s`` that stands for ``s, s + 1, ...``.
            options: ``{"reset_mask": (num_envs,) bool}`` resets only some environments.

        Raises:
            ValueError: If the number of seeds or of entries of the mask is wrong, or a seed is 2**64 or more.
        """
        one = seed if isinstance(seed, int) else None
        super().reset(seed=one)
        if seed is None or isinstance(seed, int):
            seeds = [None if one is None else one + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        chosen = np.asarray((options or {}).get("reset_mask", self._everyone), np.bool_)
        for name, length in (("seed", len(seeds)), ("reset_mask", len(chosen))):
            if length != self.num_envs:
                raise ValueError(f"{name} must have {self.num_envs} entries, got {length}")
        for i in range(self.num_envs):
            own = seeds[i]
            if chosen[i] and own is not None:
                self._stepper.seed(i, own)
            elif chosen[i] and not self._started[i]:
                self._stepper.set_key(i, random_key(self.np_random))
        self._started |= chosen
        self._over &= ~chosen
        self._stepper.reset(chosen)
        return self._stepper.observe(), self._info(chosen)

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Plays one step in every environment.

        Raises:
            ValueError: If the actions are not in the action space.
            gymnasium.error.ResetNeeded: Before the first reset.
        """
        if not self._started.all():
            raise gym.error.ResetNeeded("call reset before step")
        shape = self.action_space.shape
        assert shape is not None  # of a batch of Discrete or Box
        rewards, terminated = self._stepper.step(self.task.check_actions(actions, shape))
        truncated = self._stepper.steps >= self.max_episode_steps
        final = {}
        if self._same_step:
            over = terminated | truncated
            if over.any():
                final = self._final(over)
                self._stepper.reset(over)
            ending = np.zeros(self.num_envs, np.bool_)
        else:
            over = self._over  # since the step before: now they start anew, whatever the action
            if over.any():
                rewards[over], terminated[over], truncated[over] = 0.0, False, False
                self._stepper.reset(over)
            self._over = ending = terminated | truncated
        info = final | self._info(self._everyone, ending)
        return self._stepper.observe(), rewards, terminated, truncated, info

    def _final(self, over: NDArray[np.bool_]) -> dict[str, Any]:
        """Entries of ``info`` about the episodes that a step has ended."""
        observations = np.full(self.num_envs, None, object)
        for i, observation in zip(np.flatnonzero(over), self._stepper.observe()[over], strict=True):
            observations[i] = observation
        return {
            "final_obs": observations,
            "_final_obs": over.copy(),
            "final_info": self._info(over, over),
            "_final_info": over.copy(),
        }

    def _info(self, lanes: NDArray[np.bool_], ending: NDArray[np.bool_] | None = None) -> dict[str, Any]:
        """``info`` of the chosen environments, with ``carry_on`` for those whose episode ends."""
        states = self._stepper.state()
        known = _masked({"state": self.task.hidden(states), **self.task.details(states)}, lanes)
        if ending is not None and ending.any():
            options = self.task.carry_on(states)
            if options:
                known |= {"carry_on": _masked(options, ending), "_carry_on": ending.copy()}
        return known


def _masked(values: dict[str, NDArray[Any]], lanes: NDArray[np.bool_]) -> dict[str, Any]:
    """Arrays as Gymnasium's vectors have them: 0 where nothing is known, each with a mask ``_name`` beside it."""
    masked: dict[str, Any] = {}
    for name, array in values.items():
        masked[name] = array.copy()
        masked[name][~lanes] = 0
        masked[f"_{name}"] = lanes.copy()
    return masked


class MakesTask(Protocol):
    """A scalar class that can make its task from arguments."""

    @classmethod
    def make_task(cls, *args: Any, **kwargs: Any) -> Task:
        """The task that the class plays with these arguments."""


class VectorOf(KernelVectorEnv):
    """Many environments of one scalar class, which a subclass names in ``scalar``.

    Args:
        num_envs: Number of environments.
        autoreset_mode: When the next episode follows an ended one, ``NEXT_STEP`` or ``SAME_STEP``.
        render_mode: None, for vectors are not drawn.
        **arguments: Arguments of the scalar class's ``make_task``.

    Raises:
        ValueError: If an argument is not accepted.
    """

    scalar: ClassVar[type[MakesTask]]

    def __init__(
        self,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        **arguments: Any,
    ) -> None:
        super().__init__(self.scalar.make_task(**arguments), num_envs, autoreset_mode, render_mode)
