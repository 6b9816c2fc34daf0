"""Action spaces: the head that suits one, and a policy's numbers as the actions an environment takes."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from dpsearch.policies.heads import Categorical, Deterministic, Gaussian, Head
from dpsearch.policies.observations import UnsupportedSpaceError, one_line

UNBOUNDED = 1e30
"""Bounds of a Box from which on they count as none: many environments give the largest float32 as a bound."""


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
        f"action space {one_line(space)} is not supported: Discrete, MultiDiscrete of one dimension, and real Box are"
    )


def to_env_actions(space: gym.Space[Any], actions: NDArray[np.floating]) -> NDArray[Any]:
    """Turn a policy's actions into elements of an action space, batched.

    [-1, 1] is mapped onto the bounds of a Box where they are below ``UNBOUNDED``; a dimension without bounds takes the
    numbers as they are. The result is clipped to the bounds.

    Args:
        space: Action space of a single environment.
        actions: ``(B, A)``.

    Raises:
        UnsupportedSpaceError: If the space is none of Discrete, MultiDiscrete, Box.
    """
    match space:
        case spaces.Discrete():
            return actions[:, 0].astype(np.int64) + int(space.start)
        case spaces.MultiDiscrete():
            return actions.astype(np.int64) + space.start.astype(np.int64)
        case spaces.Box():
            low, high = space.low.ravel().astype(np.float64), space.high.ravel().astype(np.float64)
            bounded = (low > -UNBOUNDED) & (high < UNBOUNDED)
            with np.errstate(invalid="ignore", over="ignore"):
                scaled = np.where(bounded, low + (actions + 1.0) * 0.5 * (high - low), actions)
            return np.clip(scaled, low, high).astype(space.dtype).reshape(-1, *space.shape)
    raise UnsupportedSpaceError(f"action space {space} is not supported")
