"""The recipe by which a run makes its environment: plain values, which a checkpoint can hold."""

from __future__ import annotations

import dataclasses
import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import load_env_creator, parse_env_id

from dpsearch.env_kit import ObserveOnly
from dpsearch.errors import RunError
from dpsearch.options import Option, options_of
from dpsearch.policies import UnsupportedSpaceError
from dpsearch.rollout.base import Rollouts
from dpsearch.rollout.gym_engine import OnError
from dpsearch.rollout.make import make_rollouts


@dataclass(frozen=True)
class EnvRecipe:
    """A recipe for an environment.

    Attributes:
        id: Gymnasium's id; a module before a colon is imported first.
        kwargs: Arguments of the environment.
        observe_only: The components of the observation that the policy sees; None for all.
        max_episode_steps: Step limit in place of the registered one. An environment that takes its limit as an
            argument has it in ``kwargs`` instead.
        reward_threshold: Mean return that counts as solved, in place of the registered one.
    """

    id: str
    kwargs: dict[str, Any] = field(default_factory=dict)
    observe_only: list[int] | None = None
    max_episode_steps: int | None = None
    reward_threshold: float | None = None

    def make(self, render_mode: str | None = None) -> gym.Env[Any, Any]:
        """One environment.

        Raises:
            RunError: If the environment is unknown or refuses its arguments.
        """
        extra: dict[str, Any] = {} if render_mode is None else {"render_mode": render_mode}
        try:
            module, _, name = self.id.rpartition(":")
            _import(module)
            spec = gym.spec(name)  # kwargs in the spec, since gym.make would take max_episode_steps for itself
            spec = dataclasses.replace(spec, kwargs={**spec.kwargs, **self.kwargs})
            env = gym.make(spec, max_episode_steps=self.max_episode_steps, **extra)
            if self.observe_only is not None:
                env = ObserveOnly(env, self.observe_only)
        except (gym.error.Error, ImportError, TypeError, ValueError) as error:
            raise RunError(f"cannot make environment {self.id!r}: {error}") from error
        except Exception as error:  # the environment's own code: its message may make no sense without the type
            raise RunError(f"cannot make environment {self.id!r}: {type(error).__name__}: {error}") from error
        return env

    @property
    def name(self) -> str:
        """The environment's name without namespace and version: ``TMaze`` of ``dpsearch.envs:dpsearch/TMaze-v0``."""
        return parse_env_id(self.id.rpartition(":")[2])[1]

    def options(self) -> list[Option]:
        """Arguments of the environment's class, with those it is registered with as defaults.

        Raises:
            RunError: If the environment is unknown, or not made by a class.
        """
        module, _, name = self.id.rpartition(":")
        try:
            _import(module)
            spec = gym.spec(name)
            kind = load_env_creator(spec.entry_point) if isinstance(spec.entry_point, str) else spec.entry_point
        except (gym.error.Error, ImportError) as error:
            raise RunError(f"cannot make environment {self.id!r}: {error}") from error
        if not isinstance(kind, type):
            raise RunError(f"environment {self.id!r} is not made by a class, whose arguments would be its settings")
        options = options_of(kind, without={"render_mode"})
        return [dataclasses.replace(o, default=spec.kwargs.get(o.name, o.default)) for o in options]

    @property
    def stranger(self) -> str | None:
        """The module that would be imported to make the environment; None if that is ours, or imported already."""
        module = self.id.rpartition(":")[0]
        return None if module in ("", "dpsearch.envs") or module in sys.modules else module

    @property
    def drawable(self) -> bool:
        """Whether the environment can be drawn, as far as its class tells without being made."""
        entry = gym.spec(self.id.rpartition(":")[2]).entry_point
        creator = load_env_creator(entry) if isinstance(entry, str) else entry
        metadata = getattr(creator, "metadata", None)
        return metadata is None or "rgb_array" in render_modes(metadata)

    def rollouts(self, *, threads: int = 1, num_envs: int | None = None, on_error: OnError = "raise") -> Rollouts:
        """The engine that plays episodes of the environment; see ``make_rollouts`` for the arguments.

        Raises:
            RunError: If the environment cannot be made, or its spaces are of a kind that no policy can handle.
        """
        try:
            rollouts = make_rollouts(self.make, threads=threads, num_envs=num_envs, on_error=on_error)
        except (UnsupportedSpaceError, ValueError) as error:
            raise RunError(f"cannot play environment {self.id!r}: {error}") from error
        if self.reward_threshold is not None:
            rollouts.reward_threshold = self.reward_threshold
        return rollouts


def render_modes(metadata: Mapping[str, Any] | None) -> list[str]:
    """The render modes that an environment's metadata name, under today's key or the one of old environments."""
    named = metadata or {}
    return list(named.get("render_modes") or named.get("render.modes") or ())


def _import(module: str) -> None:
    """Import the module that registers an environment, if any; it may stand in the current folder.

    Python itself looks there for scripts, but not for installed commands.
    """
    if not module:
        return
    try:
        import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module.partition(".")[0] or os.getcwd() in sys.path:
            raise
        sys.path.insert(0, os.getcwd())
        import_module(module)
