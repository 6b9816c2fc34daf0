"""The settings of a run, composed the way ``train.py`` composes them."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from typing import Any

from dpsearch import config as schema
from dpsearch.algos import ALGORITHMS, Algorithm
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
    return Settings(choices["algo"], schema.checked(schema.completed(config, choices)))


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
