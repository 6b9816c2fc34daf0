"""Gymnasium environments side by side, one a lane, behind one small interface whatever their kind.

Scalar environments are stepped one by one, and only while their lane has an episode to play. Every episode
starts with a seed of its own, so what happens in it does not depend on the lane or on how many there are.
Vector environments start most episodes by themselves ("autoreset"), each in its own way; what is left of that
here is one rule: a row that was not ``played`` belongs to no episode.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from dpsearch.env_kit.symmetry import mirror_signs
from dpsearch.policies.observations import UnsupportedSpaceError, flattener
from dpsearch.policies.spaces import head_for, to_env_actions
from dpsearch.rollout.base import EnvironmentFailedError
from dpsearch.rollout.gym_envs import (
    Env,
    EnvSource,
    Factory,
    VectorEnv,
    env_factory,
    make_arguments,
    make_env,
    reward_threshold,
    step_limit,
)

Vectorization = Literal["sync", "async", "vector_entry_point"]


@dataclass(frozen=True)
class LaneStep:
    """Outcome of one step, lane by lane, ``(L,)`` each.

    Attributes:
        rewards: float64.
        terminated: True if the task ended the episode.
        truncated: True if a step limit of the environment did.
        played: False where the row was not a step: the environment was starting its next episode, or failed.
    """

    rewards: NDArray[np.float64]
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    played: NDArray[np.bool_]


def as_reward(reward: Any) -> float:
    """A reward as a float: a number, or an array that holds one.

    Raises:
        ValueError: If it is anything else.
    """
    number = np.asarray(reward)
    if number.size != 1 or number.dtype.kind not in "biuf":
        raise ValueError(f"the reward must be one number, got {reward!r}")
    return float(number.reshape(()))


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
        mirror_signs: Signs by which a mirror multiplies observations and actions, None if they do not say.
        restarts: Whether ``restart`` can begin an episode anywhere and at any time.
        failures: Lanes whose environment failed in the last call, each with the exception: it raised, or it showed or
            paid something of a wrong shape. Only single environments are told apart; other failures are raised.

    Raises:
        UnsupportedSpaceError: If a space is of a kind that no policy can handle.
    """

    capacity: int
    observations: NDArray[np.float32]
    step_limit: int | None
    reward_threshold: float | None
    mirror_signs: Sequence[float] | None
    restarts: bool

    def __init__(self, observation_space: gym.Space[Any], action_space: gym.Space[Any]) -> None:
        self.observation_space = observation_space
        self.action_space = action_space
        self.failures: dict[int, Exception] = {}
        self._flatten = flattener(observation_space)
        self.observation_size = self._flatten.size
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
        self.mirror_signs = mirror_signs(env)

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
        self.failures.clear()
        for lane in np.flatnonzero(lanes).tolist():
            try:
                observation, _ = self._envs[lane].reset(seed=int(seeds[lane]))
                self.observations[lane] = self._flatten.one(observation)
            except Exception as error:
                self.failures[lane] = error

    def step(self, actions: NDArray[np.float64], busy: NDArray[np.bool_]) -> LaneStep:
        """Play one step in the busy lanes, and only there."""
        env_actions = to_env_actions(self.action_space, actions)
        rewards = np.zeros(len(busy))
        terminated, truncated = np.zeros((2, len(busy)), np.bool_)
        played = busy.copy()
        self.failures.clear()
        for lane in np.flatnonzero(busy).tolist():
            try:
                observation, reward, over, cut, _ = self._envs[lane].step(env_actions[lane])
                self.observations[lane] = self._flatten.one(observation)
                rewards[lane], terminated[lane], truncated[lane] = as_reward(reward), over, cut
            except Exception as error:
                self.failures[lane] = error
                played[lane] = False
        return LaneStep(rewards, terminated, truncated, played)

    def replace(self, lane: int) -> None:
        """Close the environment of a lane, whatever it says, and make another."""
        with suppress(Exception):
            self._envs[lane].close()
        self._envs[lane] = self._make()

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
        env: A vector environment that came ready, or a function that makes one, with autoreset mode NEXT_STEP or
            SAME_STEP. One that was made here is closed here, and made again when it is needed again.
        restarts: Whether its ``reset`` takes a seed for each lane and ``options={"reset_mask": ...}``.

    Raises:
        ValueError: If the autoreset mode is another.
    """

    def __init__(self, env: VectorEnv | Callable[[], VectorEnv], *, restarts: bool = False) -> None:
        self._make = None if isinstance(env, gym.vector.VectorEnv) else env
        env = env if isinstance(env, gym.vector.VectorEnv) else env()
        self._env: VectorEnv | None = env
        self.capacity = env.num_envs
        self.restarts = restarts
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
        self.mirror_signs = mirror_signs(env)

    def width(self, n_episodes: int) -> int:
        """All lanes: they cannot be stepped without one another."""
        return self.capacity

    def start(self, seeds: NDArray[np.int64]) -> None:
        """Begin an episode in every lane; a vector environment that takes one seed only gets the first."""
        env = self._opened()
        with _failing():
            try:
                observations, _ = env.reset(seed=[int(seed) for seed in seeds])  # type: ignore[arg-type]
            except (TypeError, ValueError, gym.error.Error):
                observations, _ = env.reset(seed=int(seeds[0]))
            self.observations = self._flatten.batch(observations)
        self._over[:] = False

    def restart(self, lanes: NDArray[np.bool_], seeds: NDArray[np.int64]) -> None:
        """Begin an episode with a seed of its own, unless the vector environment does so by itself."""
        if self.restarts and lanes.any():
            with _failing():
                observations, _ = self._opened().reset(
                    seed=[int(seed) for seed in seeds],  # type: ignore[arg-type]
                    options={"reset_mask": lanes.copy()},
                )
                self.observations = self._flatten.batch(observations)
            self._over &= ~lanes

    def step(self, actions: NDArray[np.float64], busy: NDArray[np.bool_]) -> LaneStep:
        """Step every lane."""
        env_actions = to_env_actions(self.action_space, actions)
        with _failing():
            observations, paid, terminated, truncated, _ = self._opened().step(env_actions)
            rewards = np.asarray(paid, np.float64).reshape(self.capacity)
            self.observations = self._flatten.batch(observations)
        played = ~self._over
        ended = np.asarray(terminated, np.bool_), np.asarray(truncated, np.bool_)
        if self._next_step:
            self._over = ended[0] | ended[1]
        return LaneStep(rewards, *ended, played)

    def _opened(self) -> VectorEnv:
        if self._env is None:
            assert self._make is not None
            self._env = self._make()
        return self._env

    def close(self) -> None:
        """Close the vector environment if it was made here; it is made again when it is needed again."""
        if self._make is not None and self._env is not None:
            env, self._env = self._env, None
            try:
                env.close()
            except Exception:  # an asynchronous one with a process that has died
                env.close(terminate=True)


@contextmanager
def _failing() -> Iterator[None]:
    """Turn whatever a vector environment raises into one kind of error."""
    try:
        yield
    except Exception as error:
        raise EnvironmentFailedError(f"the vector environment failed: {type(error).__name__}: {error}") from error


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
        return _own_vector_class(source, count, make_arguments(env_kwargs, max_steps))
    make = env_factory(source, env_kwargs, max_steps)
    if vectorization == "sync":
        return ScalarLanes(make, count)
    return VectorLanes(partial(gym.vector.AsyncVectorEnv, [make] * count), restarts=True)


def _own_vector_class(source: EnvSource, count: int, arguments: dict[str, Any]) -> GymLanes:
    if not isinstance(source, str | EnvSpec):
        raise ValueError("vectorization='vector_entry_point' needs an id or a spec")
    options = {"num_envs": count, "vectorization_mode": "vector_entry_point", **arguments}
    return VectorLanes(partial(make_env, gym.make_vec, source, **options))
