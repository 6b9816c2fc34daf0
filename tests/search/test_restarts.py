"""Restarts: one run after another, each elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dpsearch.search import CMAES, FEM, NES, SNES, XNES, Restarts
from dpsearch.search.functions import FUNCTIONS
from tests.support.searches import generation, valley


def rastrigin(x: Any) -> float:
    return -float(FUNCTIONS["Rastrigin"](x))


def run_starts(restarts: Restarts, runs: int) -> list[tuple[Any, int]]:
    """Mean and population at the beginning of each run."""
    starts: list[tuple[Any, int]] = []
    while restarts.runs <= runs:
        if len(starts) < restarts.runs:
            starts.append((restarts.mean, restarts.run.population))
        generation(restarts)
    return starts


def test_restarts_find_what_single_runs_miss() -> None:
    x0, target = np.full(2, 3.2), -0.01
    single = [
        "target" in XNES(x0, 1.0, seed=s, target=target, max_evaluations=20_000, patience=200).maximize(rastrigin).stop
        for s in range(8)
    ]
    assert sum(single) <= 2
    for seed in range(8):
        search = Restarts(XNES, x0, 1.0, seed=seed, spread=3.0, target=target, max_evaluations=20_000, patience=200)
        assert "target" in search.maximize(rastrigin).stop


def test_the_first_run_is_the_search_itself_and_begins_at_x0() -> None:
    restarts = Restarts(XNES, np.ones(3), 0.5, seed=1)
    plain = XNES(np.ones(3), 0.5, seed=restarts.run.seed)
    for _ in range(10):
        np.testing.assert_array_equal(generation(restarts), generation(plain))
    np.testing.assert_array_equal(restarts.mean, plain.mean)
    np.testing.assert_array_equal(restarts.stds, plain.stds)
    assert restarts.runs == 1


@pytest.mark.parametrize("search_type", [XNES, NES, CMAES])
def test_growth_enlarges_the_populations(search_type: Any) -> None:
    restarts = Restarts(search_type, np.ones(3), 0.5, seed=1, growth=2.0, population=7, patience=15)
    assert [n for _, n in run_starts(restarts, 4)] == [7, 14, 28, 56]


def test_growth_begins_with_the_searchs_own_population() -> None:
    restarts = Restarts(XNES, np.ones(3), 0.5, seed=1, growth=1.5, patience=15)
    assert [n for _, n in run_starts(restarts, 3)] == [7, 10, 16]


def test_without_growth_all_populations_are_equal() -> None:
    restarts = Restarts(SNES, np.ones(3), 0.5, seed=1, patience=15)
    assert {n for _, n in run_starts(restarts, 4)} == {7}


def test_growth_of_a_search_without_population_is_refused_at_once() -> None:
    with pytest.raises(ValueError, match="population"):
        Restarts(FEM, np.ones(3), 0.5, growth=2.0)
    Restarts(FEM, np.ones(3), 0.5)


def test_later_runs_begin_spread_around_x0() -> None:
    restarts = Restarts(SNES, np.full(2, 5.0), [1.0, 0.1], seed=1, spread=3.0, patience=1, population=2)
    starts = np.array([mean for mean, _ in run_starts(restarts, 400)])
    np.testing.assert_array_equal(starts[0], 5.0)
    deviations = (starts[1:] - 5.0) / [3.0, 0.3]
    np.testing.assert_allclose(deviations.mean(axis=0), 0.0, atol=0.15)
    np.testing.assert_allclose(deviations.std(axis=0), 1.0, atol=0.15)


def test_without_spread_every_run_begins_at_x0_with_other_samples() -> None:
    restarts = Restarts(SNES, np.ones(2), 1.0, seed=1, spread=0.0, patience=1, population=2)
    assert all((mean == 1.0).all() for mean, _ in run_starts(restarts, 5))
    again = Restarts(SNES, np.ones(2), 1.0, seed=1, spread=0.0)
    assert restarts.run.seed != again.run.seed


def test_limits_are_those_of_all_runs_together() -> None:
    restarts = Restarts(XNES, np.ones(2), 0.5, seed=1, max_evaluations=500, patience=30)
    result = restarts.maximize(lambda x: 0.0)
    assert result.stop == {"max_evaluations": 500}
    assert result.evaluations == 500
    assert restarts.runs > 5


@pytest.mark.parametrize("search_type", [NES, XNES, FEM, CMAES])
@pytest.mark.parametrize("budget", [1, 5, 97])
def test_no_more_points_are_asked_than_the_budget_leaves(search_type: Any, budget: int) -> None:
    restarts = Restarts(search_type, np.ones(2), 0.5, seed=1, max_evaluations=budget)
    asked = 0
    while not restarts.stop():
        points = restarts.ask()
        asked += len(points)
        restarts.tell(points, [-valley(x) for x in points])
        assert restarts.evaluations == asked <= budget
    assert asked == budget


def test_a_grown_run_goes_on_from_its_state_near_the_end_of_the_budget() -> None:
    search, heir = (Restarts(XNES, np.ones(2), 0.5, seed=1, growth=2.0, max_evaluations=3000) for _ in range(2))
    while not search.stop():
        heir.load_state_dict(search.state_dict())
        np.testing.assert_array_equal(heir.ask(), search.ask())
        search.tell(search.ask(), np.zeros(len(search.ask())))
    assert search.runs > 3


@pytest.mark.parametrize("growth", [2.0, 1e200])
def test_growth_has_an_end(growth: float) -> None:
    restarts = Restarts(XNES, np.ones(2), 0.5, seed=1, growth=growth, patience=60)
    for _ in range(30):
        restarts.tell(restarts.ask(), np.zeros(len(restarts.ask())))
    assert len(restarts.ask()) == 512 * 6


def test_growth_leaves_room_for_ten_generations() -> None:
    restarts = Restarts(XNES, np.ones(2), 0.5, seed=1, growth=2.0, patience=60, max_evaluations=5000)
    while not restarts.stop():
        n = len(restarts.ask())
        assert n <= max(6, (5000 - restarts.evaluations) / 10) or restarts.run.generations > 0
        restarts.tell(restarts.ask(), np.zeros(n))
    assert restarts.evaluations == 5000


@pytest.mark.parametrize("search_type", ["xnes", XNES(np.ones(2), 1.0), Restarts, int, None])
def test_what_is_no_class_of_searches_is_refused(search_type: Any) -> None:
    with pytest.raises(ValueError, match=r"^search_type must be a class of searches, such as XNES, got [^\n]*$"):
        Restarts(search_type, np.ones(2), 1.0)


def test_options_of_the_runs_are_passed_on_and_unknown_ones_named() -> None:
    restarts = Restarts(NES, np.ones(2), 1.0, learning_rate=0.5, tolfun=None)
    assert isinstance(restarts.run, NES)
    assert restarts.run.learning_rate == 0.5
    with pytest.raises(TypeError, match=r"^bounds is not an argument of Restarts of NES; .*learning_rate"):
        Restarts(NES, np.ones(2), 1.0, bounds=[0, 1])


def test_the_best_is_that_of_all_runs() -> None:
    restarts = Restarts(XNES, np.ones(2), 0.5, seed=1, patience=20)
    told: list[float] = []
    while restarts.runs < 6:
        told += [-valley(x) for x in generation(restarts)]
    assert restarts.best.fitness == max(told)
    assert restarts.best.evaluation == int(np.argmax(told)) + 1


@pytest.mark.parametrize(
    ("argument", "options"),
    [
        ("spread", {"spread": -1.0}),
        ("spread", {"spread": np.nan}),
        ("growth", {"growth": 0.5}),
        ("patience", {"patience": 0}),
        ("population", {"population": 1}),
    ],
)
def test_an_argument_out_of_range_is_named(argument: str, options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=argument):
        Restarts(XNES, np.zeros(2), 1.0, **options)
