"""One run, made the way ``train.py`` would, and what counts as its success."""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from time import process_time
from typing import Any

import hydra
import numpy as np
from omegaconf import open_dict
from typing_extensions import override

from dpsearch import config as schema
from dpsearch.algos import ALGORITHMS, Algorithm
from dpsearch.policies import CORES
from dpsearch.rollout import Episodes, Rollouts
from scripts.experiments.jobs import Outcome

# Settings that came after the first logs of runs, with what had been meant before: they count if they differ.
LATER: dict[str, Any] = {
    "readout": True,
    "mirror": None,
    "previous_action": False,
    "learning_rate_halflife": None,
    "trace": 1.0,
    "normalise_advantages": False,
    "entropy_bonus": 0.0,
    "entropy_halflife": None,
    "imitated_steps": None,
    "wrong_turn_reward": -0.1,
    "slips": "sideways",
    "minus_reward": -1.0,
    "baseline_cells": 10,
    "baseline_optimizer": "Adam",
    "baseline_learning_rate": 0.01,
    "baseline_optimizer_options": {},
    "baseline_steps": 1,
    "natural_step": None,
    "damping": 0.01,
    "restart_episodes": None,
    "restart_gain": 0.0,
    "update_steps": None,
    "init_std": None,
    "noise_memory": 0.0,
    "advantage_memory": 0.98,
    "reward": "speed",
}
GOALS, EPISODES = 95, 100  # of the last hundred training episodes, those that must end at the goal


@dataclass(frozen=True)
class Settings:
    """A composed configuration.

    Attributes:
        algo: Name of the algorithm.
        config: Everything else.
    """

    algo: str
    config: schema.TrainConfig

    def fingerprint(self) -> str:
        """Tells settings apart by all that an outcome depends on, the seed aside."""
        config = self.config

        def counted(settings: Any) -> dict[str, Any]:
            return {k: v for k, v in asdict(settings).items() if k not in LATER or v != LATER[k]}

        parts = {
            "algo": [self.algo, counted(config.algo)],
            "env": counted(config.env),
            "policy": counted(config.policy),
            "limits": [config.total_steps, config.total_episodes, config.total_updates],
        }
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def network(self) -> str:
        """The policy's architecture, in words."""
        policy = self.config.policy
        return CORES[policy.core].words.format(policy.hidden_size)

    def rollouts(self) -> Rollouts:
        """What plays the environment."""
        return self.config.env.recipe().rollouts(num_envs=self.config.rollout.num_envs)

    def algorithm(self, rollouts: Rollouts, seed: int) -> Algorithm[Any]:
        """The algorithm at its start."""
        return ALGORITHMS[self.algo](rollouts, self.config.algo, policy=self.config.policy, seed=seed)

    def limits(self) -> dict[str, int | None]:
        """What ends a run that does not succeed."""
        config = self.config
        return {name: getattr(config, name) for name in ("total_steps", "total_episodes", "total_updates")}


@cache
def compose(overrides: tuple[str, ...]) -> Settings:
    """The configuration that ``train.py`` would have with the same overrides."""
    schema.register()
    with hydra.initialize_config_module("dpsearch.configs", version_base="1.3"):
        config = hydra.compose("train", list(overrides), return_hydra_config=True)
    choices = dict(config.hydra.runtime.choices)
    with open_dict(config):
        del config["hydra"]
    return Settings(choices["algo"], schema.checked(config, choices))


def until_solved(overrides: tuple[str, ...], seed: int) -> Outcome:
    """Learn until 100 evaluation episodes of the stochastic policy reach the environment's reward threshold."""
    settings = compose(overrides)
    algorithm = settings.algorithm(settings.rollouts(), seed)
    return _learn(algorithm, lambda: algorithm.solved, until_solved=True, **settings.limits())


def until_goals(overrides: tuple[str, ...], seed: int) -> Outcome:
    """Learn until 95 of the last 100 training episodes ended with a reward, not with a penalty or the step cap."""
    settings = compose(overrides)
    rollouts = GoalCounter(settings.rollouts())
    algorithm = settings.algorithm(rollouts, seed)
    return _learn(algorithm, lambda: rollouts.succeeds, callback=lambda *_: not rollouts.succeeds, **settings.limits())


def _learn(algorithm: Algorithm[Any], solved: Callable[[], bool], **until: Any) -> Outcome:
    algorithm.evaluate(1)  # loads the compiled code, or compiles it: that is no part of learning
    start = process_time()
    with suppress(FloatingPointError):  # it diverged, and has not succeeded
        algorithm.learn(**until)
    return {
        "solved": int(solved()),
        "evaluations": algorithm.evaluations,
        "env_steps": algorithm.env_steps,
        "episodes": algorithm.episodes,
        "updates": algorithm.updates,
        "core_seconds": process_time() - start,
    }


class GoalCounter(Rollouts):
    """Rollouts that count which of the last training episodes ended at the goal: with a reward above 0.

    Args:
        rollouts: The engine that plays them.
    """

    def __init__(self, rollouts: Rollouts) -> None:
        self._rollouts = rollouts
        self._goals: deque[bool] = deque(maxlen=EPISODES)
        self.observation_space = rollouts.observation_space
        self.action_space = rollouts.action_space
        self.observation_size = rollouts.observation_size
        self.max_steps = rollouts.max_steps
        self.reward_threshold = rollouts.reward_threshold
        self.make_env = rollouts.make_env

    @property
    def succeeds(self) -> bool:
        """Whether enough of the last hundred training episodes ended at the goal."""
        return len(self._goals) == EPISODES and sum(self._goals) >= GOALS

    @override
    def play(self, *arguments: Any, record: bool) -> Episodes:
        """Play the queued episodes; recorded ones are training."""
        episodes = self._rollouts.play(*arguments, record=record)
        if record:
            final = episodes.rewards[episodes.lengths - 1, np.arange(len(episodes))]
            self._goals.extend((episodes.terminated & (final > 0.0)).tolist())
        return episodes

    @override
    def close(self) -> None:
        """Close the engine."""
        self._rollouts.close()
