"""Throttle and brake by black-box search: ``experiment=driving_pedals``."""

from __future__ import annotations

import numpy as np
import pytest

from dpsearch.envs.driving.track import Track
from dpsearch.report.tables import SUCCESS_RATE, Row
from scripts.experiments.driving.log import LAP, NO_LAP, WALL
from scripts.experiments.driving.pedals import (
    BETTER,
    HOURS,
    NEAR,
    OFF_SHARE,
    PEDALS,
    RATIO,
    SIMULATORS,
    drive_on,
    pedals_cell,
)
from scripts.experiments.experiment import Method
from scripts.experiments.training import compose

OVERRIDES = ("experiment=driving_pedals",)


def test_a_search_learns_to_get_round_with_pedals_of_its_own() -> None:
    settings = compose(OVERRIDES)
    algorithm = settings.algorithm(settings.rollouts(), 0)
    algorithm.learn(total_steps=6_000_000)
    kwargs = settings.config.env.recipe().kwargs
    drives = [drive_on(algorithm.policy, Track(**{**kwargs, "start": "line"}), 5400) for _ in range(2)]
    algorithm.close()
    assert drives[0].distance.tolist() == drives[1].distance.tolist()
    assert drives[0].speed.mean() > 60.0  # km/h: the thesis's cars hold 70 at last
    assert sum(drives[0].off_seconds) < 18.0


def test_a_car_that_is_stuck_is_put_back_and_goes_on() -> None:
    settings = compose(OVERRIDES)
    algorithm = settings.algorithm(settings.rollouts(), 0)  # weights near 0: it rolls to a stop
    kwargs = settings.config.env.recipe().kwargs
    drive = drive_on(algorithm.policy, Track(**{**kwargs, "start": "line", "track": "oval"}), 9000)
    algorithm.close()
    assert len(drive.speed) == 9000
    assert np.sum(np.diff(drive.speed) > 5.0) > 1  # km/h in a thirtieth of a second: no engine does that


def test_one_run_has_a_line_for_each_simulator() -> None:
    rows = searches([(62.0, 58.0), (63.0, 59.0), (64.0, 60.0)], PEDALS)
    laps = [row for row in rows if row.metric == LAP]
    assert [row.mean for row in laps] == pytest.approx([63.0, 59.0])
    assert len({row.task for row in laps}) == 2


def test_of_two_runs_the_one_that_is_faster_where_it_has_learned_drives_elsewhere_too() -> None:
    rows = searches([(62.0, 58.0), (60.0, 59.0), (61.0, 60.0), (65.0, 57.0), (55.0, 55.0)], BETTER)  # the last is alone
    found = {(row.task, row.metric): row for row in rows}
    for name, lap in (("track", 60.5), ("torcs", 59.5)):
        of = {metric: found[SIMULATORS[name], metric] for metric in (LAP, HOURS, WALL)}
        assert (of[LAP].mean, of[LAP].runs, of[HOURS].mean, of[WALL].mean) == (lap, 2, 2.0, 4.0)


def test_one_run_alone_is_not_the_better_of_two() -> None:
    assert not searches([(62.0, 58.0)], BETTER)


def searches(laps: list[tuple[float, float]], method: Method) -> list[Row]:
    """The rows of a method for runs with these laps on the embedded track and in TORCS."""

    def told(lap: float) -> dict[str, float]:
        return {LAP: lap, RATIO: lap / 50.0, NEAR: 100.0, OFF_SHARE: 0.0, HOURS: 1.0, WALL: 2.0}

    outcomes = [{"solved": 1, "track": told(track), "torcs": told(torcs)} for track, torcs in laps]
    return [row for row in pedals_cell().rows(outcomes, ("settled",), "mean") if row.method == method.label]


def test_a_run_without_a_lap_counts_as_such_and_not_as_a_slow_one() -> None:
    none = {LAP: NO_LAP, RATIO: 36.0, NEAR: 0.0, OFF_SHARE: 5.0, HOURS: 1.0, WALL: 2.0}
    good = {LAP: 60.0, RATIO: 1.2, NEAR: 100.0, OFF_SHARE: 1.0, HOURS: 1.0, WALL: 2.0}
    outcomes = [{"solved": 1, "track": good, "torcs": torcs} for torcs in (good, none)]
    table = pedals_cell().rows(outcomes, (), "mean")
    rows = {row.metric: row for row in table if (row.task, row.method) == (SIMULATORS["torcs"], PEDALS.label)}
    assert (rows[SUCCESS_RATE].solved, rows[SUCCESS_RATE].runs) == (1, 2)
    assert (rows[LAP].mean, rows[NEAR].mean, rows[OFF_SHARE].mean) == (60.0, 50.0, 3.0)
