"""Gymnasium's scalar class for any environment that has a kernel.

The scalar and the vector class do nothing but call the kernel, so they agree bit for bit with each other and with the
lane engine. Randomness is keyed: ``reset(seed=s)`` starts episode 0 of seed ``s``, each further ``reset()`` the
next one, and all numbers of an episode are a function of (seed, episode, step).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from dpsearch.env_kit.drawing.canvas import Frame, Window
from dpsearch.env_kit.stepper import LaneStepper
from dpsearch.env_kit.task import PlaysTask, Task


class KernelEnv(PlaysTask, gym.Env[NDArray[Any], Any]):
    """One environment, played by its kernel. A subclass with render modes gives ``picture`` or ``text``.

    It cuts episodes off by itself, after ``max_episode_steps``. ``gym.make(..., max_episode_steps=m)`` puts
    Gymnasium's ``TimeLimit`` around it, so there the smaller of the two limits holds.

    Args:
        task: The task to play.
        render_mode: One of ``metadata["render_modes"]``, or None.

    Attributes:
        task: The task that is played.
        episode_return: Sum of the rewards of the current episode.
        last_action: The last action, None at the start of an episode.
        last_reward: The last reward, None at the start of an episode.

    Raises:
        ValueError: If there is no such render mode.
        gymnasium.error.DependencyNotInstalled: If the mode is "human" and pygame is missing.
    """

    metadata: dict[str, Any] = {"render_modes": [], "render_fps": 4}

    def __init__(self, task: Task, render_mode: str | None = None) -> None:
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            modes = ", ".join(self.metadata["render_modes"])
            raise ValueError(f"render_mode must be one of {modes}, or None, got {render_mode!r}")
        self.task = task
        self.render_mode = render_mode
        self.observation_space = task.observation_space
        self.action_space = task.action_space
        self.episode_return = 0.0
        self.last_action: Any = None
        self.last_reward: float | None = None
        self._stepper = LaneStepper(task.kernel, 1)
        self._only = np.ones(1, np.bool_)
        self._started = False
        title, rate = type(self).__name__, self.metadata["render_fps"]
        self._window = Window(title, rate) if render_mode == "human" else None

    @property
    def state_space(self) -> spaces.Discrete | spaces.Box:
        """Space of the hidden state, which ``info["state"]`` holds."""
        return self.task.state_space

    @property
    def elapsed_steps(self) -> int:
        """Steps of the current episode so far."""
        return int(self._stepper.steps[0])

    def kernel_state(self) -> NDArray[np.float64]:
        """The kernel's state, ``(state size,)``."""
        state: NDArray[np.float64] = self._stepper.state()[0]
        return state

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Starts episode 0 of ``seed``, or the next episode of the seed before.

        Args:
            seed: Seed of the episodes from here on; None keeps the seed before.
            options: Options of a subclass that can start elsewhere; else None.

        Raises:
            ValueError: If the seed is 2**64 or more, or the options are not what the subclass takes.
        """
        super().reset(seed=seed)
        place = self._place(options)
        if seed is not None:
            self._stepper.seed(0, seed)
        elif not self._started:
            self._stepper.set_key(0, random_key(self.np_random))
        self._started = True
        self._stepper.reset(self._only)
        if place is not None:
            self._stepper.put(0, place(self.kernel_state()))
        self.episode_return, self.last_action, self.last_reward = 0.0, None, None
        self._follow()
        self._show()
        return self._stepper.observe()[0], self._info()

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Plays one step.

        Raises:
            ValueError: If the action is not in the action space.
            gymnasium.error.ResetNeeded: Before the first reset.
        """
        if not self._started:
            raise gym.error.ResetNeeded("call reset before step")
        shape = self.action_space.shape
        assert shape is not None  # of a Discrete or a Box
        rewards, terminated = self._stepper.step(self.task.check_actions(action, shape))
        reward = float(rewards[0])
        self.episode_return += reward
        self.last_action, self.last_reward = action, reward
        self._follow()
        self._show()
        truncated = self.elapsed_steps >= self.max_episode_steps
        over = bool(terminated[0]) or truncated
        return self._stepper.observe()[0], reward, bool(terminated[0]), truncated, self._info(over)

    def _place(self, options: dict[str, Any] | None) -> Callable[[NDArray[np.float64]], NDArray[np.float64]] | None:
        """A function that turns the kernel's start state into the one that the options ask for; None keeps it.

        It is called before anything changes, so that bad options can be refused.
        """
        return None

    def _follow(self) -> None:
        """Called after each reset and step, before anything is drawn."""

    def _info(self, over: bool = False) -> dict[str, Any]:
        states = self._stepper.state()
        state = self.task.hidden(states)[0]
        info = {"state": int(state) if isinstance(self.state_space, spaces.Discrete) else state}
        info |= {name: values[0].item() for name, values in self.task.details(states).items()}
        options = self.task.carry_on(states) if over else {}
        return info | ({"carry_on": {name: values[0].item() for name, values in options.items()}} if options else {})

    def picture(self) -> Frame:
        """The present moment as a picture, ``(height, width, 3)``."""
        raise NotImplementedError(f"{type(self).__name__} has no picture")

    def text(self) -> str:
        """The present moment as a few lines of text."""
        raise NotImplementedError(f"{type(self).__name__} has no text")

    def render(self) -> Any:
        """A frame in mode "rgb_array", a string in mode "ansi"; mode "human" shows the frame in a window.

        Raises:
            gymnasium.error.ResetNeeded: Before the first reset.
        """
        if self.render_mode is None:
            modes = ", ".join(self.metadata["render_modes"])
            gym.logger.warn(f"nothing is drawn unless the environment is made with a render_mode: {modes}")
            return None
        if not self._started:
            raise gym.error.ResetNeeded("call reset before render")
        if self.render_mode == "ansi":
            return self.text()
        if self._window is None:
            return self.picture()
        self._window.show(self.picture())
        return None

    def _show(self) -> None:
        if self._window is not None:
            self._window.show(self.picture())

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._window is not None:
            self._window.close()


def random_key(generator: np.random.Generator) -> int:
    """A key for an environment that was given no seed."""
    return int(generator.integers(2**64, dtype=np.uint64))
