"""Between Gymnasium's spaces and a policy's flat numbers."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import concatenate, create_empty_array
from numpy.typing import NDArray

from dpsearch.policies.heads import Categorical, Deterministic, Gaussian, Head


class UnsupportedSpaceError(TypeError):
    """An environment's observation or action space is of a kind that no policy here can handle."""


def observation_size(space: gym.Space[Any]) -> int:
    """Length O of the flat observation: Discrete and MultiDiscrete are one-hot, Dict and Tuple joined.

    Raises:
        UnsupportedSpaceError: If the space has no flat form of fixed length.
    """
    flat = spaces.flatten_space(space) if space.is_np_flattenable else None
    if not isinstance(flat, spaces.Box) or len(flat.shape) != 1 or flat.shape[0] == 0:
        raise UnsupportedSpaceError(
            f"observation space {_one_line(space)} is not supported: Box, Discrete, MultiDiscrete, "
            "MultiBinary, and Dict or Tuple of these are"
        )
    return flat.shape[0]


def head_for(space: gym.Space[Any], *, deterministic: bool = False, squash: bool = True) -> Head:
    """The head that suits an action space: softmax for discrete actions, Gaussian or deterministic for a Box.

    Args:
        space: The action space.
        deterministic: Give a Box a deterministic head.
        squash: Whether that head squashes its outputs.

    Raises:
        UnsupportedSpaceError: If the space is none of Discrete, MultiDiscrete, Box.
    """
    match space:
        case spaces.Discrete():
            return Categorical([int(space.n)])
        case spaces.MultiDiscrete() if space.nvec.ndim == 1:
            return Categorical([int(n) for n in space.nvec])
        case spaces.Box() if np.issubdtype(space.dtype, np.floating) and space.shape and 0 not in space.shape:
            size = int(np.prod(space.shape))
            return Deterministic(size, squash=squash) if deterministic else Gaussian(size)
    raise UnsupportedSpaceError(
        f"action space {_one_line(space)} is not supported: Discrete, MultiDiscrete of one dimension, and real Box are"
    )


def flatten_observations(space: gym.Space[Any], observations: Any) -> NDArray[np.float32]:
    """Observations of B environments, batched as vector environments do, to flat ones ``(B, O)`` float32."""
    flat: NDArray[np.float32]
    match space:
        case spaces.Box():
            batch = np.asarray(observations, np.float32)
            flat = batch.reshape(len(batch), -1)
        case spaces.Discrete():
            flat = np.zeros((len(observations), int(space.n)), np.float32)
            flat[np.arange(len(flat)), np.asarray(observations) - int(space.start)] = 1.0
        case spaces.Dict():
            parts = [flatten_observations(part, observations[key]) for key, part in space.spaces.items()]
            flat = np.concatenate(parts, axis=1)
        case spaces.Tuple():
            pairs = zip(space.spaces, observations, strict=True)
            flat = np.concatenate([flatten_observations(part, batch) for part, batch in pairs], axis=1)
        case _:
            singles = [np.asarray(spaces.flatten(space, single)) for single in observations]
            flat = np.stack(singles).astype(np.float32)
    return flat


def to_env_actions(space: gym.Space[Any], actions: NDArray[np.floating]) -> NDArray[Any]:
    """A policy's actions ``(B, A)`` to what the environments' spaces hold, batched.

    A Box with finite bounds is mapped from [-1, 1] and clipped; one without takes the numbers as they are.
    """
    match space:
        case spaces.Discrete():
            return actions[:, 0].astype(np.int64) + int(space.start)
        case spaces.MultiDiscrete():
            return actions.astype(np.int64) + space.start.astype(np.int64)
        case spaces.Box():
            low, high = space.low.ravel().astype(np.float64), space.high.ravel().astype(np.float64)
            bounded = np.isfinite(low) & np.isfinite(high)
            with np.errstate(invalid="ignore", over="ignore"):
                scaled = np.where(bounded, low + (actions + 1.0) * 0.5 * (high - low), actions)
            return np.clip(scaled, low, high).astype(space.dtype).reshape(-1, *space.shape)
    raise UnsupportedSpaceError(f"action space {space} is not supported")


def batch_one(space: gym.Space[Any], observation: Any) -> Any:
    """A batch that holds one observation, laid out as a vector environment's."""
    empty: Any = create_empty_array(space, 1)
    return concatenate(space, [observation], empty)


def _one_line(space: gym.Space[Any]) -> str:
    return " ".join(str(space).split())
