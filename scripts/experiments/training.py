"""The settings of a run, composed the way ``train.py`` composes them."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from typing import Any

from dpsearch import config as schema
from dpsearch.algos import ALGORITHMS, Algorithm
from dpsearch.policies import CORES
from dpsearch.rollout import Rollouts


@dataclass(frozen=True)
class Settings:
    """A composed configuration.

    Attributes:
        algo: Name of the algorithm.
        config: All other settings.
    """

    algo: str
    config: schema.TrainConfig

    def fingerprint(self) -> str:
        """Tells settings apart by all that an outcome depends on, the seed aside: what differs from the defaults.

        Runs that were logged before a setting existed are found, since they had what is its default now. A default
        must not change while there are logged runs that had it.
        """
        config = self.config
        parts = {
            "algo": [self.algo, differences(config.algo)],
            "env": differences(config.env),
            "policy": differences(config.policy),
            "limits": [config.total_steps, config.total_episodes, config.total_updates],
        }
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def network(self) -> str:
        """The policy's architecture, in words."""
        policy = self.config.policy
        return CORES[policy.core].words.format(policy.hidden_size)

    def rollouts(self) -> Rollouts:
        """The engine that plays the environment."""
        return self.config.env.recipe().rollouts(num_envs=self.config.rollout.num_envs)

    def algorithm(self, rollouts: Rollouts, seed: int) -> Algorithm[Any]:
        """The algorithm at its start."""
        return ALGORITHMS[self.algo](rollouts, self.config.algo, policy=self.config.policy, seed=seed)

    def limits(self) -> dict[str, int | None]:
        """The arguments of ``Algorithm.learn`` that end a run which does not succeed."""
        config = self.config
        return {name: getattr(config, name) for name in ("total_steps", "total_episodes", "total_updates")}


def differences(settings: Any) -> dict[str, Any]:
    """The fields of a dataclass whose values are not the defaults of its class.

    Args:
        settings: The dataclass. A field that cannot be given, such as a kind, names its class and always counts.
    """
    usual, found = type(settings)(), {}
    for setting in fields(settings):
        value = getattr(settings, setting.name)
        if value != getattr(usual, setting.name) or not setting.init:
            found[setting.name] = differences(value) if is_dataclass(value) else value
    return found


@cache
def compose(overrides: tuple[str, ...]) -> Settings:
    """The configuration that ``train.py`` would have with the same overrides."""
    config, choices = schema.compose(overrides)
    return Settings(choices["algo"], schema.checked(schema.completed(config, choices, overrides)))
