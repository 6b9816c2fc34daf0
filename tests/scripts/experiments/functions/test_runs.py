from dataclasses import replace

import numpy as np
import pytest

from dpsearch.search.functions import FUNCTIONS, rotated_and_shifted
from scripts.experiments.functions.runs import Problem, cost, grid, minimise, summary

SPHERE = Problem("Sphere", 2, "cmaes", (), None, 5_000, 1e-10, True)


def test_all_methods_get_the_same_problem_of_a_seed() -> None:
    (first, one), (second, other) = (replace(SPHERE, search=name).begin(3) for name in ("cmaes", "nes"))
    np.testing.assert_array_equal(first.rotation, second.rotation)
    np.testing.assert_array_equal(first.shift, second.shift)
    np.testing.assert_array_equal(one.x0, other.x0)
    assert not np.array_equal(SPHERE.begin(4)[1].x0, one.x0)


@pytest.mark.parametrize("distance", [0.1, 100.0])
def test_the_start_is_at_its_distance_from_the_optimum(distance: float) -> None:
    function, search = replace(SPHERE, distance=distance).begin(0)
    assert np.linalg.norm(search.x0 - function.shift) == pytest.approx(distance)


def test_a_run_says_when_it_reached_the_target() -> None:
    outcome = minimise(SPHERE, 0)
    assert outcome["solved"] == 1
    assert 100 < outcome["evaluations"] < 1_000
    assert len(outcome["curve"]) >= (grid(2) <= outcome["evaluations"]).sum()
    assert outcome["curve"] == sorted(outcome["curve"], reverse=True)
    assert outcome == minimise(SPHERE, 0)


def test_a_curve_starts_with_the_best_of_the_first_points() -> None:
    function, search = SPHERE.begin(1)
    first = grid(2)[0]
    expected = np.log10(function(search.ask())[:first].min())
    assert minimise(SPHERE, 1)["curve"][0] == round(100 * expected)


def test_a_run_fails_at_its_limit() -> None:
    outcome = minimise(replace(SPHERE, max_evaluations=20), 0)
    assert outcome["solved"] == 0
    assert 20 <= outcome["evaluations"] < 30


def test_a_fingerprint_tells_all_settings_apart() -> None:
    others = [
        replace(SPHERE, function="Cigar"),
        replace(SPHERE, dimension=3),
        replace(SPHERE, search="xnes"),
        replace(SPHERE, options=(("population", 9),)),
        replace(SPHERE, distance=1.0),
        replace(SPHERE, max_evaluations=6_000),
        replace(SPHERE, tolx=1e-9),
        replace(SPHERE, curve=False),
    ]
    assert len({problem.fingerprint() for problem in (SPHERE, *others)}) == 9


def test_a_summary_keeps_runs_where_they_ended() -> None:
    outcomes = [
        {"solved": 1, "evaluations": 300, "curve": [100, 0, -500]},
        {"solved": 1, "evaluations": 200, "curve": [0, -100]},
        {"solved": 0, "evaluations": 5_000, "curve": [200, 200, 200, 200]},
    ]
    curve = summary(SPHERE, outcomes)
    np.testing.assert_allclose(curve.median[:5], [10.0, 1.0, 1e-5, 1e-10, 1e-10])
    np.testing.assert_allclose(curve.high[:5], [100.0] * 5)
    np.testing.assert_allclose(curve.low[2:5], [1e-10] * 3)
    assert curve.reached == 300
    assert summary(SPHERE, outcomes[2:]).reached is None


def test_costs_of_both_signs_survive_as_levels() -> None:
    np.testing.assert_allclose(cost(np.array([2.0, 0.0, -3.0]), True), [99.0, 0.0, -999.0])
    np.testing.assert_allclose(cost(np.array([2.0, 0.0, -10.0]), False), [100.0, 1.0, 1e-10])


def test_a_ridge_is_followed_below_zero() -> None:
    outcome = minimise(Problem("ParabR", 2, "nes", (), None, 5_000, 1e-10, True), 0)
    assert outcome["solved"] == 1
    assert outcome["curve"][-1] < -100
    assert rotated_and_shifted(FUNCTIONS["ParabR"], 2, 0).function.target == -1000.0
