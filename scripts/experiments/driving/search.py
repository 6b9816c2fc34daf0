"""Black-box search on the steering of section 3.4.4: episodes from anywhere on the road, judged by their returns."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from typing import Any, Final

import numpy as np
from typing_extensions import override

from dpsearch.algos import Algorithm
from dpsearch.algos.base import Metrics
from dpsearch.envs.driving.rules import PROFILE
from dpsearch.policies import RecurrentPolicy
from dpsearch.report.statistics import Statistic
from dpsearch.report.tables import Row
from scripts.experiments.driving.log import CLEAN, FOR_GOOD, LAP, OFF, Drive
from scripts.experiments.driving.pedals import drive_on
from scripts.experiments.experiment import Cell, Method
from scripts.experiments.jobs import Outcome
from scripts.experiments.learning import ENV_STEPS, Learned, learn
from scripts.experiments.training import Settings, compose

SEARCH: Final = Method("search", "black-box search, steering", ("algo=cmaes",))
TEST_PROFILE: Final = (10.0, 70.0, 120.0)  # the thesis's speeds, run through in two minutes
TEST_STEPS: Final = 5400  # three minutes: the third one at the highest speed
HALF_HOUR: Final = 54_000  # steps


class SearchCell(Cell):
    """Runs that search first and drive afterwards: no clean minutes begin while they learn."""

    @override
    def rows(self, outcomes: Sequence[Outcome], metrics: Sequence[str], statistic: Statistic) -> list[Row]:
        """Lines of the table, with those metrics that also make sense for a drive without learning."""
        return super().rows(outcomes, [name for name in metrics if name in (FOR_GOOD, OFF, CLEAN, LAP)], statistic)


def search_steering(overrides: tuple[str, ...], seed: int) -> Outcome:
    """Search for about half an hour of driving, then drive half an hour with what has been found."""
    settings = compose(overrides)
    run, keeps_since = searched(settings, seed)
    drive = driven(run.algorithm.policy, settings, PROFILE, HALF_HOUR)
    minutes = drive.off_seconds
    return {
        "solved": 1,
        FOR_GOOD: keeps_since,
        OFF: sum(minutes) / len(minutes),
        CLEAN: drive.clean_speed,
        LAP: drive.best_lap,
        **run.counts(ENV_STEPS),
    }


def searched(settings: Settings, seed: int) -> tuple[Learned, float]:
    """Search, and test the policy after each generation, which is no part of the search.

    Returns:
        The run, whose engine is closed; and the seconds of driving after which all tests were passed, at most those
        of the whole search.
    """
    keeps_since = np.inf

    def test(algorithm: Algorithm[Any], metrics: Metrics) -> None:
        nonlocal keeps_since
        leaves = driven(algorithm.policy, settings, TEST_PROFILE, TEST_STEPS).off_road.any()
        keeps_since = np.inf if leaves else min(keeps_since, algorithm.env_steps / 30.0)

    run = learn(settings, seed, callback=test, warm_up=False)  # no time is reported
    run.algorithm.close()
    return run, min(keeps_since, run.algorithm.env_steps / 30.0)


def driven(policy: RecurrentPolicy, settings: Settings, profile: tuple[float, float, float], steps: int) -> Drive:
    """A drive from the start line at the speeds of a profile, without learning or noise."""
    recipe = settings.config.env.recipe()
    kwargs = {**recipe.kwargs, "speed_profile": profile, "start": "line", "stuck_seconds": 1.0}
    kwargs["max_episode_steps"] = steps
    with closing(replace(recipe, kwargs=kwargs).make()) as env:
        return drive_on(policy, env, steps)
