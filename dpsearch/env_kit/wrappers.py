"""Wrappers that change observations: the hidden state instead, the previous action or reward too, or a part only.

Each wraps one environment, Gymnasium's own as well as ours, and gives flat vectors, as networks want them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.spaces.utils import flatten, flatten_space
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import ArrayLike, NDArray

from dpsearch.env_kit.symmetry import mirror_signs

Array: TypeAlias = NDArray[Any]
Env: TypeAlias = gym.Env[Array, Any]
Info: TypeAlias = dict[str, Any]


class HiddenState(gym.Wrapper[Array, Any, Array, Any], RecordConstructorArgs):
    """Makes the hidden state the observation, for an oracle that needs neither memory nor inference.

    A numbered state becomes a one-hot vector (of 2 (N + 1) + 4 numbers in a T-maze), a vector stays a vector;
    either is float32. The number itself is in ``info["state"]``, without this wrapper.

    Args:
        env: An environment that reports ``info["state"]`` and whose base has a ``state_space``.

    Raises:
        ValueError: If the environment does not tell its hidden state.
    """

    def __init__(self, env: Env) -> None:
        RecordConstructorArgs.__init__(self)
        super().__init__(env)
        space = getattr(env.unwrapped, "state_space", None)
        if not isinstance(space, spaces.Discrete | spaces.Box):
            raise ValueError(f"{env} does not tell its hidden state: it has no state_space")
        self._state_space: gym.Space[Any] = space
        flat = _flat_box(space)
        self.observation_space = _box(flat.low, flat.high, np.float32)

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Array, Info]:
        """Starts an episode."""
        _, info = self.env.reset(seed=seed, options=options)
        return self._observation(info), info

    def step(self, action: Any) -> tuple[Array, Any, bool, bool, Info]:
        """Plays one step."""
        _, reward, terminated, truncated, info = self.env.step(action)
        return self._observation(info), reward, terminated, truncated, info

    def _observation(self, info: Info) -> Array:
        return np.array(flatten(self._state_space, info["state"]), np.float32)


class _Appended(gym.Wrapper[Array, Any, Array, Any]):
    """Appends numbers that a step determines to a flat observation; they are zero at the start."""

    def __init__(self, env: Env, low: ArrayLike, high: ArrayLike) -> None:
        super().__init__(env)
        seen = _flat_observations(env)
        dtype = seen.dtype if np.issubdtype(seen.dtype, np.floating) else np.dtype(np.float32)
        self._nothing = np.zeros(np.shape(low), dtype)
        self.observation_space = _box(
            np.append(seen.low, np.minimum(low, 0)), np.append(seen.high, np.maximum(high, 0)), dtype
        )

    def _extra(self, action: Any, reward: Any) -> ArrayLike:
        raise NotImplementedError

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Array, Info]:
        """Starts an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        return np.append(observation, self._nothing).astype(self._nothing.dtype), info

    def step(self, action: Any) -> tuple[Array, Any, bool, bool, Info]:
        """Plays one step."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        longer = np.append(observation, self._extra(action, reward)).astype(self._nothing.dtype)
        return longer, reward, terminated, truncated, info


class PreviousAction(_Appended, RecordConstructorArgs):
    """Appends the previous action to the observation: one-hot if it is discrete, zeros at the start.

    Args:
        env: An environment with flat observations.

    Raises:
        ValueError: If the observations are not flat, or the actions have no flat form.
    """

    def __init__(self, env: Env) -> None:
        RecordConstructorArgs.__init__(self)
        flat = _flat_box(env.action_space)
        super().__init__(env, flat.low, flat.high)

    def _extra(self, action: Any, reward: Any) -> ArrayLike:
        return np.asarray(flatten(self.env.action_space, action))


class PreviousReward(_Appended, RecordConstructorArgs):
    """Appends the previous reward to the observation, 0 at the start.

    Args:
        env: An environment with flat observations.

    Raises:
        ValueError: If the observations are not flat.
    """

    def __init__(self, env: Env) -> None:
        RecordConstructorArgs.__init__(self)
        super().__init__(env, [-np.inf], [np.inf])

    def _extra(self, action: Any, reward: Any) -> ArrayLike:
        return [float(reward)]


class ObserveOnly(gym.ObservationWrapper[Array, Any, Array], RecordConstructorArgs):
    """Keeps some components of the observation, and so makes an environment partially observable.

    ``ObserveOnly(gymnasium.make("CartPole-v1"), indices=[0, 2])`` hides the velocities.

    Args:
        env: An environment with flat observations.
        indices: Which components to keep, in this order.

    Raises:
        ValueError: If the observations are not flat, or the indices are none, not distinct or out of range.
    """

    def __init__(self, env: Env, indices: Sequence[int]) -> None:
        RecordConstructorArgs.__init__(self, indices=indices)
        super().__init__(env)
        seen = _flat_observations(env)
        size = seen.shape[0]
        self._indices = list(indices)
        distinct = len(set(self._indices)) == len(self._indices) > 0
        if not distinct or not all(0 <= i < size for i in self._indices):
            raise ValueError(f"indices must be distinct and in 0 .. {size - 1}, got {self._indices}")
        self.observation_space = _box(seen.low[self._indices], seen.high[self._indices], seen.dtype)

    @property
    def mirror_signs(self) -> tuple[float, ...] | None:
        """The signs of the components that are kept, then those of the action; None if there are none inside."""
        signs, seen = mirror_signs(self.env), self.env.observation_space.shape
        if signs is None or seen is None or len(signs) < seen[0]:
            return None
        return (*(signs[i] for i in self._indices), *signs[seen[0] :])

    def observation(self, observation: Array) -> Array:
        """The components that are kept."""
        kept: Array = observation[self._indices]
        return kept


def _box(low: Array, high: Array, dtype: Any) -> spaces.Box:
    return spaces.Box(low.astype(dtype), high.astype(dtype), dtype=dtype)


def _flat_box(space: gym.Space[Any]) -> spaces.Box:
    """The flat form of a space: one-hot for whole numbers."""
    flat = flatten_space(space)
    if not isinstance(flat, spaces.Box):
        raise ValueError(f"{space} has no form as a vector of fixed length")
    return flat


def _flat_observations(env: Env) -> spaces.Box:
    space = env.observation_space
    if not isinstance(space, spaces.Box) or len(space.shape) != 1:
        raise ValueError(f"observations must be flat, not {space}: see gymnasium.wrappers.FlattenObservation")
    return space
