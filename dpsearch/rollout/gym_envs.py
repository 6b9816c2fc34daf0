"""Gymnasium environments side by side, one a lane, behind one small interface whatever their kind.

Scalar environments are stepped one by one, and only while their lane has an episode to play. Every episode
starts with a seed of its own, so what happens in it does not depend on the lane or on how many there are.
Vector environments start most episodes by themselves ("autoreset"), each in its own way; what is left of that
here is one rule: a row that was not ``played`` belongs to no episode.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from dpsearch.policies.spaces import (
    UnsupportedSpaceError,
    flatten_observations,
    head_for,
    observation_size,
    to_env_actions,
)

Env = gym.Env[Any, Any]
VectorEnv = gym.vector.VectorEnv[Any, Any, Any]
Factory = Callable[[], Env]
EnvSource = str | EnvSpec | Env | VectorEnv | Callable[..., Env]
"""Everything that names an environment: an id, a spec, an environment, a vector environment, or a factory."""
Vectorization = Literal["sync", "async", "vector_entry_point"]


@dataclass(frozen=True)
class LaneStep:
    """What one step brought, lane by lane, ``(L,)`` each.

    Attributes:
        rewards: float64.
        terminated: True if the task ended the episode.
        truncated: True if a step limit of the environment did.
        played: False where the row was not a step: the environment was busy starting its next episode.
    """

    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    played: NDArray[np.bool_]


class GymLanes(ABC):
    """Environments that are stepped together.

    Args:
        observation_space: Of one environment.
        action_space: Of one environment.

    Attributes:
        capacity: The most lanes there can be.
        observations: ``(L, O)`` float32, what each lane sees now.
        step_limit: Steps after which the environments cut an episode off, None if they do not say.
        reward_threshold: Mean return that counts as solved, None if they do not say.
        restarts: Whether ``restart`` can begin an episode anywhere and at any time.

    Raises:
        UnsupportedSpaceError: If a space is of a kind that no policy can handle.
    """

    capacity: int
    observations: NDArray[np.float32]
    step_limit: int | None
    reward_threshold: float | None
    restarts: bool

    def __init__(self, observation_space: gym.Space[Any], action_space: gym.Space[Any]) -> None:
        self.observation_space = observation_space
        self.action_space = action_space
        self.observation_size = observation_size(observation_space)
        self.action_size = head_for(action_space).action_size

    @abstractmethod
    def width(self, n_episodes: int) -> int:
        """The number L of lanes to play some episodes with."""

    @abstractmethod
    def start(self, seeds: NDArray[np.int64]) -> None:
        """Begin an episode in each of L lanes, with the seeds ``(L,)`` if the environments take so many."""

    @abstractmethod
    def step(self, actions: NDArray[np.float64], busy: NDArray[np.bool_]) -> LaneStep:
        """Play one step in the lanes that are ``busy (L,)``, and perhaps in the others.

        Args:
            actions: ``(L, A)``, the policy's own numbers.
            busy: Where a step is wanted.
        """

    @abstractmethod
    def restart(self, lanes: NDArray[np.bool_], seeds: NDArray[np.int64]) -> None:
        """Begin an episode in some lanes ``(L,)``, unless the environments do it by themselves."""

    @abstractmethod
    def close(self) -> None:
        """Close the environments that were made here; those that came ready are their owner's."""


class ScalarLanes(GymLanes):
    """Single environments, stepped in a loop.

    Args:
        make: Makes one environment.
        capacity: The most there can be; they are made when first needed.
    """

    restarts = True

    def __init__(self, make: Factory, capacity: int) -> None:
        self.capacity = capacity
        self._make = make
        env = make()
        self._envs = [env]
        try:
            super().__init__(env.observation_space, env.action_space)
        except UnsupportedSpaceError:
            self.close()
            raise
        self.step_limit = step_limit(env)
        self.reward_threshold = reward_threshold(env)

    def width(self, n_episodes: int) -> int:
        """As many lanes as episodes, up to the capacity."""
        return min(n_episodes, self.capacity)

    def start(self, seeds: NDArray[np.int64]) -> None:
        """Begin an episode in each of L lanes."""
        while len(self._envs) < len(seeds):
            self._envs.append(self._make())
        self.observations = np.zeros((len(seeds), self.observation_size), np.float32)
        self.restart(np.ones(len(seeds), np.bool_), seeds)

    def restart(self, lanes: NDArray[np.bool_], seeds: NDArray[np.int64]) -> None:
        """Begin an episode in some lanes."""
        for lane in np.flatnonzero(lanes):
            observation, _ = self._envs[lane].reset(seed=int(seeds[lane]))
            self._see(lane, observation)

    def step(self, actions: NDArray[np.float64], busy: NDArray[np.bool_]) -> LaneStep:
        """Play one step in the busy lanes, and only there."""
        env_actions = to_env_actions(self.action_space, actions)
        rewards = np.zeros(len(busy))
        terminated, truncated = np.zeros((2, len(busy)), np.bool_)
        for lane in np.flatnonzero(busy):
            observation, rewards[lane], terminated[lane], truncated[lane], _ = self._envs[lane].step(env_actions[lane])
            self._see(lane, observation)
        return LaneStep(rewards, terminated, truncated, busy)

    def _see(self, lane: np.intp, observation: Any) -> None:
        self.observations[lane] = np.asarray(spaces.flatten(self.observation_space, observation), np.float32)

    def close(self) -> None:
        """Close the environments; more are made when they are needed again."""
        while self._envs:
            self._envs.pop().close()


class ReadyLane(ScalarLanes):
    """One environment that came ready made: it is played as it is, in the only lane."""

    def __init__(self, env: Env) -> None:
        super().__init__(lambda: env, 1)

    def close(self) -> None:
        """Leave the environment to its owner."""


class VectorLanes(GymLanes):
    """A vector environment.

    Args:
        env: With autoreset mode NEXT_STEP or SAME_STEP.
        restarts: Whether its ``reset`` takes a seed for each lane and ``options={"reset_mask": ...}``.
        owned: Whether ``close`` closes it.

    Raises:
        ValueError: If the autoreset mode is another.
    """

    def __init__(self, env: VectorEnv, *, restarts: bool = False, owned: bool = False) -> None:
        self.capacity = env.num_envs
        self.restarts = restarts
        self._env = env
        self._owned = owned
        mode = env.metadata.get("autoreset_mode")
        try:
            if mode not in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP):
                raise ValueError(f"autoreset mode {mode} is not supported: NEXT_STEP and SAME_STEP are")
            super().__init__(env.single_observation_space, env.single_action_space)
        except (ValueError, UnsupportedSpaceError):
            self.close()
            raise
        self._next_step = mode == AutoresetMode.NEXT_STEP
        self._over = np.zeros(env.num_envs, np.bool_)  # the lanes that the next step will not play
        self.step_limit = step_limit(env)
        self.reward_threshold = reward_threshold(env)

    def width(self, n_episodes: int) -> int:
        """All lanes: they cannot be stepped without one another."""
        return self.capacity

    def start(self, seeds: NDArray[np.int64]) -> None:
        """Begin an episode in every lane; a vector environment that takes one seed only gets the first."""
        try:
            observations, _ = self._env.reset(seed=[int(seed) for seed in seeds])  # type: ignore[arg-type]
        except (TypeError, ValueError, gym.error.Error):
            observations, _ = self._env.reset(seed=int(seeds[0]))
        self._see(observations)
        self._over[:] = False

    def restart(self, lanes: NDArray[np.bool_], seeds: NDArray[np.int64]) -> None:
        """Begin an episode with a seed of its own, unless the vector environment does so by itself."""
        if self.restarts and lanes.any():
            observations, _ = self._env.reset(
                seed=[int(seed) for seed in seeds],  # type: ignore[arg-type]
                options={"reset_mask": lanes.copy()},
            )
            self._see(observations)
            self._over &= ~lanes

    def step(self, actions: NDArray[np.float64], busy: NDArray[np.bool_]) -> LaneStep:
        """Step every lane."""
        env_actions = to_env_actions(self.action_space, actions)
        observations, rewards, terminated, truncated, _ = self._env.step(env_actions)
        played = ~self._over
        ended = np.asarray(terminated, np.bool_), np.asarray(truncated, np.bool_)
        if self._next_step:
            self._over = ended[0] | ended[1]
        self._see(observations)
        return LaneStep(np.asarray(rewards, np.float64), *ended, played)

    def _see(self, observations: Any) -> None:
        self.observations = flatten_observations(self.observation_space, observations)

    def close(self) -> None:
        """Close the vector environment if it was made here."""
        if self._owned:
            self._env.close()


def open_lanes(
    source: EnvSource,
    num_envs: int | None = None,
    max_steps: int | None = None,
    vectorization: Vectorization = "sync",
    env_kwargs: dict[str, Any] | None = None,
) -> GymLanes:
    """Lanes for an environment given in any form; ``GymEngine`` says what the arguments mean.

    Raises:
        UnsupportedSpaceError: If a space is of a kind that no policy can handle.
        ValueError: If the environment is unknown, or an argument does not apply to it.
    """
    if vectorization not in ("sync", "async", "vector_entry_point"):
        raise ValueError(f"vectorization must be 'sync', 'async' or 'vector_entry_point', got {vectorization!r}")
    if isinstance(source, gym.Env | gym.vector.VectorEnv):
        if num_envs is not None or env_kwargs or vectorization != "sync":
            raise ValueError("a ready environment takes neither num_envs, env_kwargs nor vectorization: give a factory")
        return ReadyLane(source) if isinstance(source, gym.Env) else VectorLanes(source)
    count = 32 if num_envs is None else num_envs
    if vectorization == "vector_entry_point":
        return _own_vector_class(source, count, _make_arguments(env_kwargs, max_steps))
    make = env_factory(source, env_kwargs, max_steps)
    if vectorization == "sync":
        return ScalarLanes(make, count)
    return VectorLanes(gym.vector.AsyncVectorEnv([make] * count), restarts=True, owned=True)


def env_factory(
    source: str | EnvSpec | Callable[..., Env],
    env_kwargs: dict[str, Any] | None = None,
    max_steps: int | None = None,
) -> Factory:
    """What makes one environment of a kind.

    Args:
        source: An id ("CartPole-v1", "module:Name-v0", "dpsearch/TMaze-v0"), a spec, or a factory.
        env_kwargs: Arguments of the environment, or of the factory.
        max_steps: Step limit in place of the registered one; a factory knows its own.
    """
    if not isinstance(source, str | EnvSpec):
        return partial(source, **(env_kwargs or {}))
    return partial(_make, gym.make, source, **_make_arguments(env_kwargs, max_steps))


def single_env(source: EnvSource, env_kwargs: dict[str, Any] | None, max_steps: int | None) -> Factory | None:
    """What makes one more environment of a kind; None if what there is came ready."""
    if isinstance(source, gym.Env | gym.vector.VectorEnv):
        return None
    return env_factory(source, env_kwargs, max_steps)


def _own_vector_class(source: EnvSource, count: int, arguments: dict[str, Any]) -> GymLanes:
    if not isinstance(source, str | EnvSpec):
        raise ValueError("vectorization='vector_entry_point' needs an id or a spec")
    env = _make(gym.make_vec, source, num_envs=count, vectorization_mode="vector_entry_point", **arguments)
    return VectorLanes(env, owned=True)


def _make_arguments(env_kwargs: dict[str, Any] | None, max_steps: int | None) -> dict[str, Any]:
    limit = {} if max_steps is None else {"max_episode_steps": max_steps}
    return {**(env_kwargs or {}), **limit}


def _make(make: Callable[..., Any], source: str | EnvSpec, **arguments: Any) -> Any:
    """Call ``gym.make`` or ``gym.make_vec``, with one error for all that can be wrong with an id."""
    name = source if isinstance(source, str) else source.id
    if name.startswith("dpsearch/"):
        import_module("dpsearch.envs")  # registers them
    try:
        return make(source, **arguments)
    except (gym.error.Error, ModuleNotFoundError) as error:
        raise ValueError(f"cannot make environment {name!r}: {error}") from error


def step_limit(env: Env | VectorEnv) -> int | None:
    """Steps after which an episode is cut off: the smallest limit an environment names, None without any."""
    spec = _spec(env)
    limits = [
        getattr(env.unwrapped, "max_episode_steps", None),
        None if spec is None else spec.max_episode_steps,
    ]
    layer: Any = env
    while isinstance(layer, gym.Wrapper):
        if isinstance(layer, gym.wrappers.TimeLimit):
            limits.append(layer._max_episode_steps)
        layer = layer.env
    return min((limit for limit in limits if limit is not None), default=None)


def reward_threshold(env: Env | VectorEnv) -> float | None:
    """Mean return that counts as solved, None if the environment names none."""
    spec = _spec(env)
    own: float | None = getattr(env.unwrapped, "reward_threshold", None)
    return own if spec is None else spec.reward_threshold


def _spec(env: Env | VectorEnv) -> EnvSpec | None:
    if env.spec is None and isinstance(env, gym.vector.SyncVectorEnv | gym.vector.AsyncVectorEnv):
        spec: EnvSpec | None = env.get_attr("spec")[0]
        return spec
    return env.spec
