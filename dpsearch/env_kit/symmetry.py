"""Mirror symmetry: the signs by which a mirror multiplies an environment's observations and actions.

An environment that is alike on the left and on the right declares them as an attribute ``mirror_signs``: a 1 or -1 for
each number of the flat observation, then for each of the action.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
from gymnasium import vector

_CHANGING = (
    gym.ObservationWrapper,
    gym.ActionWrapper,
    vector.VectorObservationWrapper,
    vector.VectorActionWrapper,
)


def mirror_signs(env: gym.Env[Any, Any] | vector.VectorEnv[Any, Any, Any]) -> Sequence[float] | None:
    """The signs that an environment declares, None if it declares none.

    A wrapper that changes observations or actions has to declare signs of its own: those of the environment inside do
    not hold outside of it.
    """
    layer: Any = env
    while not ("mirror_signs" in vars(layer) or hasattr(type(layer), "mirror_signs")):
        inner = _inside(layer)
        if inner is None or isinstance(layer, _CHANGING) or _spaces(layer) != _spaces(inner):
            return None
        layer = inner
    signs: Sequence[float] | None = layer.mirror_signs
    return signs


def _inside(layer: Any) -> Any:
    """The environment that a wrapper wraps, or the first of a vector; None for neither."""
    if isinstance(layer, vector.SyncVectorEnv):
        return layer.envs[0]
    return layer.env if isinstance(layer, gym.Wrapper | vector.VectorWrapper) else None


def _spaces(layer: Any) -> tuple[gym.Space[Any], gym.Space[Any]]:
    """Observation space and action space of one environment."""
    if isinstance(layer, vector.VectorEnv):
        return layer.single_observation_space, layer.single_action_space
    return layer.observation_space, layer.action_space
