"""The choice of the engine that plays an environment: lanes if it has a kernel, else Gymnasium's own interface."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker, TimeLimit

from dpsearch.env_kit.symmetry import mirror_signs
from dpsearch.kernels.lanes import EnvKernel
from dpsearch.rollout.base import Rollouts
from dpsearch.rollout.gym_engine import GymEngine, OnError
from dpsearch.rollout.gym_envs import (
    Env,
    EnvSource,
    VectorEnv,
    env_factory,
    limit_or_default,
    reward_threshold,
    single_env,
    step_limit,
)
from dpsearch.rollout.lane_engine import LaneEngine

_TRANSPARENT = (
    TimeLimit,
    OrderEnforcing,
    PassiveEnvChecker,
)  # what gym.make adds: none changes what is seen or paid


def make_rollouts(
    env: EnvSource,
    *,
    threads: int = 1,
    num_envs: int | None = None,
    env_kwargs: dict[str, Any] | None = None,
    max_episode_steps: int | None = None,
    on_error: OnError = "raise",
) -> Rollouts:
    """Rollouts of an environment, by the fastest engine that can play it.

    Args:
        env: An id ("CartPole-v1", "module:Name-v0", "dpsearch/TMaze-v0"), a spec, an environment, a vector
            environment, or a factory.
        threads: Threads of the lane engine, 1 for the gym engine; results do not depend on it.
        num_envs: Environments that the gym engine plays side by side, 32 if None; None for the lane engine.
        env_kwargs: Arguments of the environment, or of the factory.
        max_episode_steps: Step limit of an episode, in place of the registered one; if the environment has none either,
            1,000 with a warning.
        on_error: What the gym engine does when an environment fails, ``"raise"`` or ``"retry"``; see ``GymEngine``.

    Raises:
        UnsupportedSpaceError: If a space is of a kind that no policy can handle.
        ValueError: If the environment is unknown, or an argument is out of range or of no use to the engine.
    """
    if isinstance(env, gym.Env | gym.vector.VectorEnv):
        lanes = None if env_kwargs else _compiled(env, threads, max_episode_steps)
    else:
        probe = env_factory(env, env_kwargs, max_episode_steps)()
        lanes = _compiled(probe, threads, max_episode_steps)
        probe.close()
    if lanes is None:
        if threads != 1:
            raise ValueError(
                f"threads must be 1, got {threads}: the environment has no compiled kernel, so it is stepped in one "
                "thread, num_envs of its kind side by side"
            )
        limits: dict[str, Any] = {"max_episode_steps": max_episode_steps, "env_kwargs": env_kwargs}
        return GymEngine(env, num_envs=num_envs, on_error=on_error, **limits)
    if num_envs is not None:
        raise ValueError(f"num_envs must be null, got {num_envs}: the environment's compiled kernel is played in lanes")
    lanes.make_env = single_env(env, env_kwargs, max_episode_steps)
    return lanes


def _compiled(env: Env | VectorEnv, threads: int, max_episode_steps: int | None) -> LaneEngine | None:
    """The lane engine, if the environment has a kernel and no wrapper changes what the kernel does."""
    kernel = getattr(env.unwrapped, "kernel", None)
    if not isinstance(kernel, EnvKernel) or not _is_bare(env):
        return None
    limit = limit_or_default(max_episode_steps, step_limit(env))
    spaces: tuple[gym.Space[Any], gym.Space[Any]] = (
        (env.single_observation_space, env.single_action_space)
        if isinstance(env, gym.vector.VectorEnv)
        else (env.observation_space, env.action_space)
    )
    # where the most that can be earned depends on the limit, the task itself knows what counts as solved under it
    own_threshold = getattr(getattr(env.unwrapped, "task", None), "threshold", None)
    return LaneEngine(
        kernel,
        max_steps=limit,
        threads=threads,
        observation_space=spaces[0],
        action_space=spaces[1],
        reward_threshold=own_threshold(limit) if own_threshold else reward_threshold(env),
        mirror_signs=mirror_signs(env),
    )


def _is_bare(env: Env | VectorEnv) -> bool:
    layer: Any = env
    while layer is not env.unwrapped:
        if type(layer) not in _TRANSPARENT:
            return False
        layer = layer.env
    return True
