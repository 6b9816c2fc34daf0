"""Steering by black-box search: ``algo=cmaes env=track`` and ``algo=xnes env=track``."""

from __future__ import annotations

import pytest

from scripts.experiments.driving.log import SETTLED
from scripts.experiments.driving.search import (
    SEARCH,
    TEST_PROFILE,
    TEST_STEPS,
    SearchCell,
    driven,
    search_steering,
    searched,
)
from scripts.experiments.training import compose


@pytest.mark.parametrize("search", ["cmaes", "xnes"])
def test_a_search_learns_to_keep_to_the_road_within_half_an_hour_of_driving(search: str) -> None:
    settings = compose((f"algo={search}", "env=track"))
    start = settings.algorithm(settings.rollouts(), 0)
    before = driven(start.policy, settings, TEST_PROFILE, TEST_STEPS)
    start.close()
    run, keeps_since = searched(settings, 0)
    after = driven(run.algorithm.policy, settings, TEST_PROFILE, TEST_STEPS)
    assert before.off_road.any()
    assert not after.off_road.any()
    assert 0.0 < keeps_since < 1800.0
    assert after.speed[-1] == pytest.approx(70.0, abs=1.0)


def test_what_a_search_comes_up_with_drives_half_an_hour_on_the_road() -> None:
    outcome = search_steering((*SEARCH.overrides, "env=track"), 0)
    assert outcome["off"] == 0.0
    assert outcome["clean"] == pytest.approx(69.0, abs=0.5)  # the mean speed of the last minute up to 70 km/h
    assert 0.0 < outcome["for_good"] < outcome["env_steps"] / 30.0


def test_a_line_of_the_table_has_what_a_search_has() -> None:
    settings = compose(SEARCH.overrides)
    cell = SearchCell("a road", SEARCH, SEARCH.overrides, settings)
    rows = cell.rows([{"solved": 1, "lap": 170.0 + k} for k in range(3)], (SETTLED, "lap"), "mean")
    assert [row.metric for row in rows[1:]] == ["lap"]
    assert rows[1].mean == 171.0
