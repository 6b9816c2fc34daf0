"""Gymnasium classes, scalar and vector, for any environment that has a kernel.

Both do nothing but call the kernel, so they agree bit for bit with each other and with the lane engine.
Their randomness is keyed: ``reset(seed=s)`` starts episode 0 of seed ``s``, each further ``reset()`` the next
one, and all numbers of an episode are a function of (seed, episode, step). Environment ``i`` of a vector that
is seeded with the number ``s`` has seed ``s + i``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from dpsearch.envs.drawing import Frame, Window
from dpsearch.envs.lane_stepper import LaneStepper
from dpsearch.kernels.lanes import EnvKernel


@dataclass(frozen=True)
class Task:
    """What there is to know about an environment with a kernel.

    Attributes:
        kernel: The dynamics.
        observation_space: What the agent sees, a flat box of float32.
        action_space: ``Discrete``, counting from 0, or a flat ``Box``, whose actions the kernel takes to its
            bounds if they lie beyond.
        state_space: What ``info["state"]`` holds: the number in row 0 of the kernel's state if this is
            ``Discrete``, the whole state if it is a ``Box``.
        max_episode_steps: Steps after which an episode is cut off, at least 1.

    Raises:
        ValueError: If ``max_episode_steps`` is below 1.
    """

    kernel: EnvKernel
    observation_space: spaces.Box
    action_space: spaces.Discrete | spaces.Box
    state_space: spaces.Discrete | spaces.Box
    max_episode_steps: int

    def __post_init__(self) -> None:
        if self.max_episode_steps < 1:
            raise ValueError(f"max_episode_steps must be at least 1, got {self.max_episode_steps}")

    def hidden(self, states: NDArray[np.float64]) -> NDArray[Any]:
        """The hidden states in some states of the kernel ``(n, state size)``; see ``state_space``."""
        return states[:, 0].astype(np.int64) if isinstance(self.state_space, spaces.Discrete) else states

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


class KernelEnv(gym.Env[NDArray[Any], Any]):
    """One environment, played by its kernel. A subclass with render modes gives ``picture`` or ``text``.

    It cuts episodes off by itself, after ``max_episode_steps``. ``gym.make(..., max_episode_steps=m)`` puts
    Gymnasium's ``TimeLimit`` around it, so there the smaller of the two limits holds.

    Args:
        task: What to play.
        render_mode: One of ``metadata["render_modes"]``, or None.

    Attributes:
        task: What is played.
        episode_return: Sum of the rewards of the current episode.
        last_action: The action before now, None at the start of an episode.

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
        self._stepper = LaneStepper(task.kernel, 1)
        self._only = np.ones(1, np.bool_)
        self._started = False
        self._spec: EnvSpec | None = None
        title, rate = type(self).__name__, self.metadata["render_fps"]
        self._window = Window(title, rate) if render_mode == "human" else None

    @property
    def kernel(self) -> EnvKernel:
        """The compiled dynamics."""
        return self.task.kernel

    @property
    def max_episode_steps(self) -> int:
        """Steps after which an episode is cut off."""
        return self.task.max_episode_steps

    @property
    def state_space(self) -> spaces.Discrete | spaces.Box:
        """What ``info["state"]`` holds: the hidden state."""
        return self.task.state_space

    @property
    def elapsed_steps(self) -> int:
        """Steps of the current episode so far."""
        return int(self._stepper.steps[0])

    @property
    def spec(self) -> EnvSpec | None:
        """How the environment was made. Its limit is that of this task, for a registered spec has none."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None and spec.max_episode_steps is None:
            spec = replace(spec, max_episode_steps=self.max_episode_steps)
        self._spec = spec

    def kernel_state(self) -> NDArray[np.float64]:
        """The kernel's state, ``(state size,)``."""
        state: NDArray[np.float64] = self._stepper.state()[0]
        return state

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Starts episode 0 of ``seed``, or the next episode of the seed before; there are no options.

        Raises:
            ValueError: If the seed is 2**64 or more.
        """
        super().reset(seed=seed)
        if seed is not None:
            self._stepper.seed(0, seed)
        elif not self._started:
            self._stepper.set_key(0, random_key(self.np_random))
        self._started = True
        self._stepper.reset(self._only)
        self.episode_return, self.last_action = 0.0, None
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
        self.last_action = action
        self._show()
        truncated = self.elapsed_steps >= self.max_episode_steps
        return self._stepper.observe()[0], reward, bool(terminated[0]), truncated, self._info()

    def _info(self) -> dict[str, Any]:
        state = self.task.hidden(self._stepper.state())[0]
        return {"state": int(state) if isinstance(self.state_space, spaces.Discrete) else state}

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


class KernelVectorEnv(VectorEnv[NDArray[np.float32], NDArray[Any], NDArray[Any]]):
    """Many environments of one task, played by its kernel.

    Args:
        task: What to play.
        num_envs: How many environments.
        autoreset_mode: When the next episode follows an ended one, ``NEXT_STEP`` or ``SAME_STEP``.
        render_mode: None, for vectors are not drawn.

    Attributes:
        task: What is played.

    Raises:
        ValueError: If an argument is none of these.
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

    @property
    def kernel(self) -> EnvKernel:
        """The compiled dynamics."""
        return self.task.kernel

    @property
    def max_episode_steps(self) -> int:
        """Steps after which an episode is cut off."""
        return self.task.max_episode_steps

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Starts episode 0 of the seeds, or the next episode where none is given.

        Args:
            seed: One for each environment, or a number ``s`` that stands for ``s, s + 1, ...``.
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
        else:
            over = self._over  # since the step before: now they start anew, whatever the action
            if over.any():
                rewards[over], terminated[over], truncated[over] = 0.0, False, False
                self._stepper.reset(over)
            self._over = terminated | truncated
        return self._stepper.observe(), rewards, terminated, truncated, final | self._info(self._everyone)

    def _final(self, over: NDArray[np.bool_]) -> dict[str, Any]:
        """What the info of a step says about the episodes that it ended."""
        observations = np.full(self.num_envs, None, object)
        for i, observation in zip(np.flatnonzero(over), self._stepper.observe()[over], strict=True):
            observations[i] = observation
        return {
            "final_obs": observations,
            "_final_obs": over.copy(),
            "final_info": self._info(over),
            "_final_info": over.copy(),
        }

    def _info(self, lanes: NDArray[np.bool_]) -> dict[str, Any]:
        states = self.task.hidden(self._stepper.state())
        states[~lanes] = 0  # as Gymnasium fills in where it knows nothing
        return {"state": states, "_state": lanes.copy()}


def random_key(generator: np.random.Generator) -> int:
    """A key for an environment that was given no seed."""
    return int(generator.integers(2**64, dtype=np.uint64))
