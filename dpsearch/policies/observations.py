"""Observations of any Gymnasium space as a policy's flat numbers.

``flattener`` looks at a space once and makes a ``Flattener``, which turns one observation, or a vector environment's
batch of them, into float32 numbers. Values are taken as they are, whatever their dtype: an image may hold floats, a
position may lie just outside its bounds. A shape other than the space's is refused, never broadcast.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from typing_extensions import override

Flat = NDArray[np.float32]
SUPPORTED = "Box, Discrete, MultiDiscrete, MultiBinary, and Dict or Tuple of these"


class UnsupportedSpaceError(TypeError):
    """An environment's observation or action space is of a kind that no policy here can handle."""


class Flattener(ABC):
    """Turns observations of one space into flat numbers.

    Attributes:
        size: Length O of a flat observation.
    """

    size: int

    @abstractmethod
    def one(self, observation: Any) -> Flat:
        """The flat form ``(O,)`` of one observation.

        Raises:
            ValueError: If the observation does not have the shape that its space says.
        """

    @abstractmethod
    def batch(self, observations: Any) -> Flat:
        """The flat form ``(B, O)`` of B observations, batched as by Gymnasium's vector environments.

        Raises:
            ValueError: If the observations do not have the shape that their space says.
        """

    @abstractmethod
    def is_one(self, observation: Any) -> bool | None:
        """True for one observation, False for a batch, None if it may be either: ``array([2])`` for a Discrete.

        Raises:
            ValueError: If it is neither.
        """


def flattener(space: gym.Space[Any]) -> Flattener:
    """The flattener of an observation space.

    Discrete and MultiDiscrete become one-hot, the parts of a Dict or Tuple are joined in the space's order, as
    ``gymnasium.spaces.flatten`` does. A part of no fixed length, such as a text, is left out with a warning.

    Raises:
        UnsupportedSpaceError: If nothing of the space has a flat form of fixed length.
    """
    found = _flattener(space, "observation")
    if found is None or found.size == 0:
        raise UnsupportedSpaceError(f"observation space {one_line(space)} is not supported: {SUPPORTED} are")
    return found


def observation_size(space: gym.Space[Any]) -> int:
    """Length O of the flat observation.

    Raises:
        UnsupportedSpaceError: If nothing of the space has a flat form of fixed length.
    """
    return flattener(space).size


def one_line(space: gym.Space[Any]) -> str:
    """A space in words, on one line."""
    return " ".join(str(space).split())


def _flattener(space: gym.Space[Any], name: str) -> Flattener | None:
    match space:
        case spaces.Box() | spaces.MultiBinary():
            return _Numbers(space.shape, name)
        case spaces.Discrete():
            return _OneHot(int(space.n), int(space.start), name)
        case spaces.MultiDiscrete():
            return _SeveralOneHot(space, name)
        case spaces.Dict():
            return _joined(((key, f"{name}[{key!r}]", part) for key, part in space.spaces.items()), Mapping, name)
        case spaces.Tuple():
            return _joined(((i, f"{name}[{i}]", part) for i, part in enumerate(space.spaces)), tuple, name)
    return None


def _joined(parts: Iterable[tuple[Any, str, gym.Space[Any]]], kind: type, name: str) -> Flattener | None:
    found = {}
    for key, label, space in parts:
        part = _flattener(space, label)
        if part is None:
            warnings.warn(f"{label} is left out: {one_line(space)} has no flat form of fixed length", stacklevel=5)
        else:
            found[key] = part
    return _Joined(found, kind, name) if found else None


class _Numbers(Flattener):
    """A Box or MultiBinary: the numbers themselves, row by row."""

    def __init__(self, shape: tuple[int, ...], name: str) -> None:
        self._shape, self._name = shape, name
        self.size = int(np.prod(shape))

    @override
    def one(self, observation: Any) -> Flat:
        numbers = np.asarray(observation, np.float32)
        if numbers.shape != self._shape:
            raise _wrong_shape(self._name, numbers.shape, self._shape)
        flat: Flat = numbers.reshape(self.size)
        return flat

    @override
    def batch(self, observations: Any) -> Flat:
        numbers = np.asarray(observations, np.float32)
        if numbers.shape[1:] != self._shape or numbers.ndim == 0:
            raise _wrong_shape(self._name, numbers.shape, ("B", *self._shape))
        return numbers.reshape(len(numbers), self.size)

    @override
    def is_one(self, observation: Any) -> bool | None:
        return _is_one(np.shape(observation), self._shape, self._name)


class _OneHot(Flattener):
    """A Discrete: 1 at the place of the value, 0 elsewhere."""

    def __init__(self, size: int, start: int, name: str) -> None:
        self.size = size
        self._start, self._name = start, name

    @override
    def one(self, observation: Any) -> Flat:
        if np.size(observation) != 1:
            raise _wrong_shape(self._name, np.shape(observation), ())
        flat: Flat = self.batch(np.reshape(observation, 1))[0]
        return flat

    @override
    def batch(self, observations: Any) -> Flat:
        values = np.asarray(observations)
        if values.ndim != 1:
            raise _wrong_shape(self._name, values.shape, ("B",))
        flat = np.zeros((len(values), self.size), np.float32)
        flat[np.arange(len(values)), _places(values, self._start, self.size, self._name)] = 1.0
        return flat

    @override
    def is_one(self, observation: Any) -> bool | None:
        shape = np.shape(observation)
        return None if shape == (1,) else _is_one(shape, (), self._name)


class _SeveralOneHot(Flattener):
    """A MultiDiscrete: one-hot groups, one behind the other."""

    def __init__(self, space: spaces.MultiDiscrete, name: str) -> None:
        self._shape, self._name = space.shape, name
        self._choices, self._start = space.nvec.ravel().astype(np.int64), space.start.ravel().astype(np.int64)
        self._first = np.cumsum([0, *self._choices[:-1]])
        self.size = int(self._choices.sum())

    @override
    def one(self, observation: Any) -> Flat:
        if np.shape(observation) != self._shape:
            raise _wrong_shape(self._name, np.shape(observation), self._shape)
        flat: Flat = self.batch(np.asarray(observation)[None])[0]
        return flat

    @override
    def batch(self, observations: Any) -> Flat:
        values = np.asarray(observations)
        if values.shape[1:] != self._shape or values.ndim == 0:
            raise _wrong_shape(self._name, values.shape, ("B", *self._shape))
        values = values.reshape(len(values), -1)
        flat = np.zeros((len(values), self.size), np.float32)
        places = self._first + _places(values, self._start, self._choices, self._name)
        flat[np.arange(len(values))[:, None], places] = 1.0
        return flat

    @override
    def is_one(self, observation: Any) -> bool | None:
        return _is_one(np.shape(observation), self._shape, self._name)


class _Joined(Flattener):
    """A Dict or Tuple: its parts, one behind the other."""

    def __init__(self, parts: Mapping[Any, Flattener], kind: type, name: str) -> None:
        self._parts, self._kind, self._name = parts, kind, name
        self.size = sum(part.size for part in parts.values())

    def _pairs(self, observation: Any) -> list[tuple[Flattener, Any]]:
        """Each part with its share of an observation."""
        try:
            return [(part, observation[key]) for key, part in self._parts.items()]
        except (KeyError, IndexError, TypeError) as error:
            wanted = "with " + ", ".join(map(repr, self._parts)) if self._kind is Mapping else f"of {len(self._parts)}"
            kind = "mapping" if self._kind is Mapping else "tuple"
            raise ValueError(f"{self._name} must be a {kind} {wanted}, got {_short(observation)}") from error

    @override
    def one(self, observation: Any) -> Flat:
        return np.concatenate([part.one(share) for part, share in self._pairs(observation)])

    @override
    def batch(self, observations: Any) -> Flat:
        return np.concatenate([part.batch(share) for part, share in self._pairs(observations)], axis=1)

    @override
    def is_one(self, observation: Any) -> bool | None:
        answers = {part.is_one(share) for part, share in self._pairs(observation)} - {None}
        if len(answers) > 1:
            raise ValueError(f"{self._name} has parts that are one observation and parts that are a batch")
        return answers.pop() if answers else None


def _is_one(shape: tuple[int, ...], wanted: tuple[int, ...], name: str) -> bool:
    if shape == wanted:
        return True
    if shape[1:] == wanted and shape:
        return False
    raise _wrong_shape(name, shape, wanted)


def _places(values: NDArray[Any], start: Any, count: Any, name: str) -> NDArray[np.int64]:
    """Places of the ones in one-hot groups: the values, minus the first value of the space."""
    places: NDArray[np.int64] = values.astype(np.int64) - start
    if not (np.equal(values, places + start) & (places >= 0) & (places < count)).all():
        last = np.max(np.asarray(start) + count - 1)
        raise ValueError(f"{name} must be a whole number up to {last}, got {_short(values)}")
    return places


def _wrong_shape(name: str, shape: tuple[Any, ...], wanted: tuple[Any, ...]) -> ValueError:
    words = str(wanted).replace("'", "")
    return ValueError(f"{name} has shape {shape}, the observation space says {words}")


def _short(value: Any) -> str:
    text = " ".join(repr(value).split())
    return text if len(text) <= 60 else f"{text[:57]}..."
