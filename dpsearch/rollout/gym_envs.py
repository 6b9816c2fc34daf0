"""Gymnasium environments from whatever names them, and the limits they declare."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import partial
from importlib import import_module
from numbers import Integral
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import EnvSpec

Env = gym.Env[Any, Any]
VectorEnv = gym.vector.VectorEnv[Any, Any, Any]
Factory = Callable[[], Env]
EnvSource = str | EnvSpec | Env | VectorEnv | Callable[..., Env]
"""Everything that names an environment: an id, a spec, an environment, a vector environment, or a factory."""

DEFAULT_LIMIT = 1000
"""Steps after which an episode is cut off where neither the user nor the environment says."""


def env_factory(
    source: str | EnvSpec | Callable[..., Env],
    env_kwargs: dict[str, Any] | None = None,
    max_steps: int | None = None,
) -> Factory:
    """A function that makes one environment of a kind.

    Args:
        source: An id ("CartPole-v1", "module:Name-v0", "dpsearch/TMaze-v0"), a spec, or a factory.
        env_kwargs: Arguments of the environment, or of the factory.
        max_steps: Step limit in place of the registered one; a factory knows its own.
    """
    if not isinstance(source, str | EnvSpec):
        return partial(source, **(env_kwargs or {}))
    return partial(make_env, gym.make, source, **make_arguments(env_kwargs, max_steps))


def single_env(source: EnvSource, env_kwargs: dict[str, Any] | None, max_steps: int | None) -> Factory | None:
    """A function that makes one more environment of a kind; None for an environment that came ready made."""
    if isinstance(source, gym.Env | gym.vector.VectorEnv):
        return None
    return env_factory(source, env_kwargs, max_steps)


def make_arguments(env_kwargs: dict[str, Any] | None, max_steps: int | None) -> dict[str, Any]:
    """Keyword arguments for ``gym.make`` or ``gym.make_vec``: the environment's own, and a step limit if given."""
    limit = {} if max_steps is None else {"max_episode_steps": max_steps}
    return {**(env_kwargs or {}), **limit}


def make_env(make: Callable[..., Any], source: str | EnvSpec, **arguments: Any) -> Any:
    """Call ``gym.make`` or ``gym.make_vec``, with one error for all that can be wrong with an id."""
    name = source if isinstance(source, str) else source.id
    if name.startswith("dpsearch/"):
        import_module("dpsearch.envs")  # registers them
    try:
        return make(source, **arguments)
    except (gym.error.Error, ModuleNotFoundError) as error:
        raise ValueError(f"cannot make environment {name!r}: {error}") from error


def step_limit(env: Env | VectorEnv) -> int | None:
    """Steps after which an environment cuts an episode off: the smallest limit that holds, None without any.

    An attribute ``max_episode_steps`` that is no positive whole number names no limit: some environments say 0 or -1
    for none.
    """
    if isinstance(env, gym.vector.SyncVectorEnv):
        return step_limit(env.envs[0])
    if isinstance(env, gym.vector.AsyncVectorEnv):
        spec = env.get_attr("spec")[0]
        return _valid(None if spec is None else spec.max_episode_steps)
    limits = [_valid(getattr(env.unwrapped, "max_episode_steps", None))]
    layer: Any = env
    while layer is not env.unwrapped:
        if isinstance(layer, gym.wrappers.TimeLimit):
            limits.append(_valid(layer._max_episode_steps))
        layer = layer.env
    if isinstance(env, gym.vector.VectorEnv):  # a class of its own cuts off by itself, as its spec says
        limits.append(_valid(None if env.spec is None else env.spec.max_episode_steps))
    return min((limit for limit in limits if limit is not None), default=None)


def limit_or_default(*limits: int | None) -> int:
    """The smallest of several step limits; with a warning ``DEFAULT_LIMIT`` if there is none."""
    known = [limit for limit in limits if limit is not None]
    if not known:
        warnings.warn(
            f"max_episode_steps is taken to be {DEFAULT_LIMIT}: the environment names no step limit", stacklevel=4
        )
    return min(known, default=DEFAULT_LIMIT)


def _valid(limit: Any) -> int | None:
    counts = isinstance(limit, Integral) and not isinstance(limit, bool)
    return int(limit) if counts and limit >= 1 else None


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
