"""Utilities by rank."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from dpsearch.search.shaping import log_rank, relative_rank, top_linear
from tests.support.searches import Array

SHAPINGS: dict[str, Callable[[Array], Array]] = {
    "relative": relative_rank,
    "log": log_rank,
    "top": partial(top_linear, m=3),
}


@pytest.fixture(params=SHAPINGS)
def shaping(request: pytest.FixtureRequest) -> Callable[[Array], Array]:
    return SHAPINGS[request.param]


def test_relative_rank_is_twice_the_rank_less_one_for_the_better_half() -> None:
    fitness = np.array([30.0, 10.0, 50.0, 20.0, 40.0])  # relative ranks 0.5, 0, 1, 0.25, 0.75
    np.testing.assert_array_equal(relative_rank(fitness), [0.0, 0.0, 1.0, 0.0, 0.5])
    np.testing.assert_allclose(relative_rank(np.arange(4.0)), [0.0, 0.0, 1 / 3, 1.0], rtol=1e-12)
    np.testing.assert_array_equal(relative_rank(np.array([7.0])), [1.0])


@pytest.mark.parametrize("n", [2, 5, 30])
def test_log_rank_is_the_formula_of_xnes(n: int) -> None:
    raw = np.array([max(0.0, np.log(n / 2 + 1) - np.log(k)) for k in range(1, n + 1)])
    np.testing.assert_allclose(log_rank(-np.arange(float(n))), raw / raw.sum() - 1 / n, rtol=0, atol=1e-15)


def test_top_linear_goes_from_one_down_to_zero_behind_the_best_m() -> None:
    np.testing.assert_allclose(top_linear(np.arange(6.0), 4), [0.0, 0.0, 0.25, 0.5, 0.75, 1.0], rtol=1e-12)
    np.testing.assert_array_equal(top_linear(np.arange(3.0), 1), [0.0, 0.0, 1.0])


def test_sums_do_not_depend_on_the_fitness(shaping: Callable[[Array], Array]) -> None:
    sums = {"relative": 25 / 9, "log": 0.0, "top": 2.0}
    expected = next(sums[name] for name, function in SHAPINGS.items() if function is shaping)
    rng = np.random.default_rng(0)
    for fitness in (rng.standard_normal(10), rng.integers(0, 3, 10).astype(float), np.zeros(10)):
        assert shaping(fitness).sum() == pytest.approx(expected, abs=1e-12)


def test_equals_share_the_mean_of_their_ranks(shaping: Callable[[Array], Array]) -> None:
    for fitness in itertools.product([0.0, 1.0, 2.0, -np.inf], repeat=5):
        values = np.array(fitness)
        by_rank = shaping(-np.arange(5.0))
        ranks = {f: [i for i, g in enumerate(sorted(fitness, reverse=True)) if g == f] for f in fitness}
        np.testing.assert_allclose(shaping(values), [by_rank[ranks[f]].mean() for f in fitness], rtol=0, atol=1e-15)


def test_minus_infinity_is_last(shaping: Callable[[Array], Array]) -> None:
    fitness = np.array([-1e300, -np.inf, 3.0, 5.0, 0.0])
    np.testing.assert_array_equal(shaping(fitness), shaping(np.array([1.0, 0.0, 3.0, 4.0, 2.0])))


def test_utilities_follow_their_points(shaping: Callable[[Array], Array]) -> None:
    rng = np.random.default_rng(1)
    fitness, order = rng.standard_normal(12), rng.permutation(12)
    np.testing.assert_array_equal(shaping(fitness)[order], shaping(fitness[order]))


def test_only_the_order_counts(shaping: Callable[[Array], Array]) -> None:
    fitness = np.random.default_rng(2).standard_normal(12)
    np.testing.assert_array_equal(shaping(fitness), shaping(np.exp(5.0 * fitness) - 1e6))


def test_what_is_returned_may_be_changed(shaping: Callable[[Array], Array]) -> None:
    first = shaping(np.arange(6.0))
    expected = first.copy()
    first[:] = 9.0
    np.testing.assert_array_equal(shaping(np.arange(6.0)), expected)
