"""Learning under a stop watch, and the two ways in which a run of learning succeeds."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from time import perf_counter, process_time
from typing import Any

import numpy as np
from typing_extensions import override

from dpsearch.algos import Algorithm
from dpsearch.algos.base import Metrics
from dpsearch.rollout import Episodes, Rollouts
from scripts.experiments.jobs import Outcome
from scripts.experiments.training import Settings, compose

EVALUATIONS, ENV_STEPS, EPISODES, UPDATES = "evaluations", "env_steps", "episodes", "updates"
CORE_SECONDS = "core_seconds"
GOALS, RECENT = 95, 100  # of the last hundred training episodes, those that must end at the goal

Callback = Callable[[Algorithm[Any], Metrics], bool | None]


@dataclass(frozen=True)
class Learned:
    """A run of learning that has ended.

    Attributes:
        algorithm: The algorithm, with the policy that it has come to.
        core_seconds: CPU time of the learning.
        wall_seconds: Time that passed while it learned.
    """

    algorithm: Algorithm[Any]
    core_seconds: float
    wall_seconds: float

    def counts(self, *names: str) -> Outcome:
        """Some of the numbers that any run has, by name: ``evaluations``, ``env_steps``, .., ``core_seconds``."""
        return {name: getattr(self if name == CORE_SECONDS else self.algorithm, name) for name in names}


def learn(
    settings: Settings,
    seed: int,
    *,
    rollouts: Rollouts | None = None,
    callback: Callback | None = None,
    until_solved: bool = False,
    warm_up: bool = True,
) -> Learned:
    """Learn until the settings' limits are reached, the callback ends it, or the algorithm diverges.

    Divergence is no error: the policy is then as the last update left it.

    Args:
        settings: The settings, limits included.
        seed: Seed of the run.
        rollouts: Plays the episodes; None for what the settings choose.
        callback: Called after each update with the algorithm and its metrics; False ends the run.
        until_solved: Whether the run also ends at the environment's reward threshold.
        warm_up: Whether to load or compile all compiled code before the watch starts, which is no part of learning.
    """
    if warm_up:
        _warm_up(settings, seed)
    algorithm = settings.algorithm(settings.rollouts() if rollouts is None else rollouts, seed)
    core, wall = process_time(), perf_counter()
    with suppress(FloatingPointError):
        algorithm.learn(**settings.limits(), until_solved=until_solved, callback=callback)
    return Learned(algorithm, process_time() - core, perf_counter() - wall)


def _warm_up(settings: Settings, seed: int) -> None:
    """Make the first update of a twin that is then thrown away: kernels are compiled, or loaded, at their first use."""
    twin = settings.algorithm(settings.rollouts(), seed)
    twin.evaluate(1)
    with suppress(FloatingPointError):
        twin.update()
    twin.close()


def until_solved(overrides: tuple[str, ...], seed: int) -> Outcome:
    """Learn until 100 evaluation episodes of the stochastic policy reach the environment's reward threshold."""
    run = learn(compose(overrides), seed, until_solved=True)
    return _outcome(run, solved=run.algorithm.solved)


def until_goals(overrides: tuple[str, ...], seed: int) -> Outcome:
    """Learn until 95 of the last 100 training episodes ended with a reward, not with a penalty or the step cap."""
    settings = compose(overrides)
    rollouts = GoalCounter(settings.rollouts())
    run = learn(settings, seed, rollouts=rollouts, callback=lambda *_: not rollouts.succeeds)
    return _outcome(run, solved=rollouts.succeeds)


def _outcome(run: Learned, *, solved: bool) -> Outcome:
    return {"solved": int(solved), **run.counts(EVALUATIONS, ENV_STEPS, EPISODES, UPDATES, CORE_SECONDS)}


class GoalCounter(Rollouts):
    """Rollouts that count which of the last training episodes ended at the goal: with a reward above 0.

    Args:
        rollouts: The engine that plays them.
    """

    def __init__(self, rollouts: Rollouts) -> None:
        self._rollouts = rollouts
        self._goals: deque[bool] = deque(maxlen=RECENT)
        self.observation_space = rollouts.observation_space
        self.action_space = rollouts.action_space
        self.observation_size = rollouts.observation_size
        self.max_steps = rollouts.max_steps
        self.reward_threshold = rollouts.reward_threshold
        self.make_env = rollouts.make_env
        self.mirror_signs = rollouts.mirror_signs

    @property
    def succeeds(self) -> bool:
        """Whether enough of the last hundred training episodes ended at the goal."""
        return len(self._goals) == RECENT and sum(self._goals) >= GOALS

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
