"""Gymnasium classes, scalar and vector, for any environment that has a kernel.

Both do nothing but call the kernel, so they agree bit for bit with each other and with the lane engine. Their
randomness is keyed: ``reset(seed=s)`` starts episode 0 of seed ``s``, each further ``reset()`` the next episode, and
all numbers of an episode are a function of (seed, episode, step). Environment ``i`` of a vector seeded with the whole
number ``s`` has seed ``s + i``.
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
        observation_space: What the agent sees, a flat box.
        action_space: ``Discrete``, or a flat ``Box`` whose actions the kernel takes to its bounds.
        state_space: What ``info["state"]`` holds: the hidden state.
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

    def hidden(self, state: NDArray[np.float64]) -> NDArray[np.int64] | NDArray[np.float64]:
        """The hidden states in some kernel states ``(n, state size)``: their indices ``(n,)``, or all of it."""
        return state[:, 0].astype(np.int64) if isinstance(self.state_space, spaces.Discrete) else state

    def check_actions(self, actions: Any, space: gym.Space[Any]) -> NDArray[np.generic]:
        """The actions as an array of the shape of ``space``: the task's action space, or a batch of it.

        Raises:
            ValueError: If the shape is wrong, a discrete action is not one of the space, or a number is not finite.
        """
        array = np.asarray(actions)
        good = array.shape == space.shape
        if isinstance(self.action_space, spaces.Discrete):
            good = good and array.dtype.kind in "iu"
            good = good and bool(((array >= 0) & (array < self.action_space.n)).all())
        else:
            good = good and array.dtype.kind in "iuf" and bool(np.isfinite(array).all())
        if not good:
            raise ValueError(f"an action must be in {space}, got {actions!r}")
        return array


class KernelEnv(gym.Env[NDArray[np.float32], Any]):
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
            raise ValueError(
                f"render_mode must be one of {self.metadata['render_modes']}, got {render_mode!r}"
            )
        self.task = task
        self.render_mode = render_mode
        self.observation_space = task.observation_space
        self.action_space = task.action_space
        self.episode_return = 0.0
        self.last_action: Any = None
        self._stepper = LaneStepper(task.kernel, 1)
        self._has_key = self._started = False
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
        """How the environment was made; it knows the limit that this very task has."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        if spec is not None and spec.max_episode_steps is None:
            spec = replace(spec, max_episode_steps=self.max_episode_steps)
        self._spec = spec

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
        elif not self._has_key:
            self._stepper.set_key(0, int(self.np_random.integers(2**64, dtype=np.uint64)))
        self._has_key = self._started = True
        self._stepper.reset(np.ones(1, np.bool_))
        self.episode_return, self.last_action = 0.0, None
        self._show()
        return self._stepper.observe()[0], self._info()

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Plays one step.

        Raises:
            ValueError: If the action is not one of the action space.
            gymnasium.error.ResetNeeded: Before the first reset.
        """
        if not self._started:
            raise gym.error.ResetNeeded("call reset before the first step")
        checked = self.task.check_actions(action, self.action_space)
        rewards, terminated = self._stepper.step(checked)
        reward = float(rewards[0])
        self.episode_return += reward
        self.last_action = action
        self._show()
        truncated = self.elapsed_steps >= self.max_episode_steps
        return self._stepper.observe()[0], reward, bool(terminated[0]), truncated, self._info()

    def _info(self) -> dict[str, Any]:
        state = self.task.hidden(self._stepper.state())[0]
        return {"state": int(state) if isinstance(self.state_space, spaces.Discrete) else state}

    def kernel_state(self) -> NDArray[np.float64]:
        """The kernel's state, ``(state size,)``."""
        return self._stepper.state()[0]

    def picture(self) -> Frame:
        """The present moment as a picture, ``(height, width, 3)`` uint8."""
        raise NotImplementedError(f"{type(self).__name__} has no picture")

    def text(self) -> str:
        """The present moment as a few lines of text."""
        raise NotImplementedError(f"{type(self).__name__} has no text")

    def render(self) -> Any:
        """A frame in mode "rgb_array", a string in mode "ansi"; in mode "human" it is shown, and None returned.

        Raises:
            gymnasium.error.ResetNeeded: Before the first reset.
        """
        if self.render_mode is None:
            gym.logger.warn(f"nothing is drawn without a render_mode: {self.metadata['render_modes']}")
            return None
        if not self._started:
            raise gym.error.ResetNeeded("call reset before render")
        if self.render_mode == "ansi":
            return self.text()
        if self._window is None:
            return self.picture()
        self._window.show(self.picture())
        return None

    def close(self) -> None:
        """Closes the window, if there is one."""
        if self._window is not None:
            self._window.close()

    def _show(self) -> None:
        if self._window is not None:
            self.render()


class KernelVectorEnv(VectorEnv[NDArray[np.float32], NDArray[Any], NDArray[Any]]):
    """Many environments of one task, played by its kernel.

    Args:
        task: What to play.
        num_envs: How many environments.
        autoreset_mode: When an ended episode is followed by the next: ``NEXT_STEP`` or ``SAME_STEP``.
        render_mode: None; vectors are not drawn.

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
            raise ValueError('a vector of environments is drawn with vectorization_mode="sync" only')
        self._autoreset_mode = AutoresetMode(autoreset_mode)
        if self._autoreset_mode == AutoresetMode.DISABLED:
            raise ValueError("autoreset_mode must be NEXT_STEP or SAME_STEP")
        self.metadata = {**self.metadata, "autoreset_mode": self._autoreset_mode}
        self.task = task
        self.num_envs = num_envs
        self.single_observation_space = task.observation_space
        self.single_action_space = task.action_space
        self.observation_space = batch_space(task.observation_space, num_envs)
        self.action_space = batch_space(task.action_space, num_envs)
        self._stepper = LaneStepper(task.kernel, num_envs)
        self._has_key = np.zeros(num_envs, np.bool_)
        self._over = np.zeros(num_envs, np.bool_)

    @property
    def kernel(self) -> EnvKernel:
        """The compiled dynamics."""
        return self.task.kernel

    @property
    def max_episode_steps(self) -> int:
        """Steps after which an episode is cut off."""
        return self.task.max_episode_steps

    def reset(  # type: ignore[override]  # one seed for each environment, as Gymnasium's own vectors take
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Starts the first episode of some seeds, or the next episode where there is none.

        Args:
            seed: One for each environment, or a number ``s`` that stands for ``s, s + 1, ...``.
            options: ``{"reset_mask": (num_envs,) bool}`` resets only some environments.

        Raises:
            ValueError: If the number of seeds or the shape of the mask is wrong, or a seed is not in [0, 2**64).
        """
        super().reset(seed=seed if isinstance(seed, int) else None)
        if seed is None or isinstance(seed, int):
            seeds = [None if seed is None else seed + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        mask = np.asarray((options or {}).get("reset_mask", np.ones(self.num_envs, np.bool_)))
        for name, length in (("seed", len(seeds)), ("reset_mask", len(mask))):
            if length != self.num_envs:
                raise ValueError(f"{name} must have {self.num_envs} entries, got {length}")
        for lane in np.flatnonzero(mask):
            lane_seed = seeds[lane]
            if lane_seed is not None:
                self._stepper.seed(lane, lane_seed)
            elif not self._has_key[lane]:
                self._stepper.set_key(lane, int(self.np_random.integers(2**64, dtype=np.uint64)))
        self._has_key |= mask
        self._over &= ~mask
        self._stepper.reset(mask)
        return self._stepper.observe(), self._info(mask)

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[np.float32], NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Plays one step in every environment.

        Raises:
            ValueError: If the actions are not in the action space.
            gymnasium.error.ResetNeeded: Before the first reset.
        """
        if not self._has_key.all():
            raise gym.error.ResetNeeded("call reset before the first step")
        checked = self.task.check_actions(actions, self.action_space)
        rewards, terminated = self._stepper.step(checked)
        truncated = self._stepper.steps >= self.max_episode_steps
        everyone = np.ones(self.num_envs, np.bool_)
        if self._autoreset_mode == AutoresetMode.NEXT_STEP:
            fresh = self._over
            if fresh.any():
                self._stepper.reset(fresh)
                rewards[fresh], terminated[fresh], truncated[fresh] = 0.0, False, False
            self._over = terminated | truncated
            return self._stepper.observe(), rewards, terminated, truncated, self._info(everyone)
        observations, infos = self._stepper.observe(), {}
        over = terminated | truncated
        if over.any():
            final = np.full(self.num_envs, None, object)
            for lane in np.flatnonzero(over):
                final[lane] = observations[lane].copy()
            infos = {"final_obs": final, "_final_obs": over.copy()}
            infos |= {"final_info": self._info(over), "_final_info": over.copy()}
            self._stepper.reset(over)
            observations = self._stepper.observe()
        return observations, rewards, terminated, truncated, infos | self._info(everyone)

    def _info(self, lanes: NDArray[np.bool_]) -> dict[str, Any]:
        states = self.task.hidden(self._stepper.state())
        states[~lanes] = 0  # as Gymnasium leaves what it has no information about
        return {"state": states, "_state": lanes.copy()}
