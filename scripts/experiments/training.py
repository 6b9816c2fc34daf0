"""The settings of a run, composed the way ``train.py`` composes them."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import hydra
from omegaconf import open_dict

from dpsearch import config as schema
from dpsearch.algos import ALGORITHMS, Algorithm
from dpsearch.algos.baselines.base import BaselineConfig
from dpsearch.rollout import Rollouts

# Settings of environments and policies that came after the first logs of runs: they count if they differ from these.
LATER: dict[str, Any] = {
    "readout": True,
    "previous_action": False,
    "wrong_turn_reward": -0.1,
    "slips": "sideways",
    "minus_reward": -1.0,
    "init_std": None,
    "noise_memory": 0.0,
    "reward": "speed",
}


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
        """Tells settings apart by all that an outcome depends on, the seed aside."""
        config = self.config

        def counted(settings: Any) -> dict[str, Any]:
            return {k: v for k, v in asdict(settings).items() if k not in LATER or v != LATER[k]}

        parts = {
            "algo": [self.algo, _differing(config.algo)],
            "env": counted(config.env),
            "policy": counted(config.policy),
            "limits": [config.total_steps, config.total_episodes, config.total_updates],
        }
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def network(self) -> str:
        """The policy's architecture, in words."""
        policy = self.config.policy
        cores = {"lstm": "LSTM, {} cells", "rnn": "Elman, {} units", "none": "no memory, {} units"}
        return cores[policy.core].format(policy.hidden_size)

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


def _differing(settings: Any) -> dict[str, Any]:
    """Settings that differ from the defaults of their class: a new setting changes no fingerprint."""
    given, defaults = vars(settings), vars(type(settings)())
    parts = {k: {"kind": v.kind, **_differing(v)} if isinstance(v, BaselineConfig) else v for k, v in given.items()}
    return {k: v for k, v in parts.items() if given[k] != defaults[k]}


@cache
def compose(overrides: tuple[str, ...]) -> Settings:
    """The configuration that ``train.py`` would have with the same overrides."""
    schema.register()
    with hydra.initialize_config_module("dpsearch.configs", version_base="1.3"):
        config = hydra.compose("train", list(overrides), return_hydra_config=True)
    choices = dict(config.hydra.runtime.choices)
    with open_dict(config):
        del config["hydra"]
    return Settings(choices["algo"], schema.checked(config, choices, overrides))
