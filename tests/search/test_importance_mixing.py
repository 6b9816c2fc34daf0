"""Importance mixing: the population stays distributed as the search distribution, and few points are new."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats

from dpsearch.search import NES, Search, importance_mixing
from dpsearch.search.functions import FUNCTIONS, rotated_and_shifted
from dpsearch.search.gaussian import GaussianSearch
from tests.support.searches import Array

SHIFT = np.array([0.6, -0.3])
STRETCH = np.array([[0.7, 0.2], [-0.1, 1.2]])


class Marching(GaussianSearch):
    """A search that takes the same step always, in local coordinates, and remembers the generations it learned from."""

    name = "marching"

    def __init__(self, shift: Array, stretch: Array, **options: Any) -> None:
        self.diagonal = stretch.ndim == 1
        super().__init__(np.zeros(2), 1.0, population=8000, seed=11, importance_mixing=True, **options)
        self.step = shift, stretch
        self.learned: list[Array] = []

    def _step(self, local: Array, fitness: Array) -> tuple[Array, Array]:
        self.learned.append(local)
        return self.step

    def march(self, generations: int) -> list[Array]:
        """The populations, in coordinates in which each should be N(0, I)."""
        for _ in range(generations):
            self.tell(self.ask(), np.zeros(len(self.ask())))
        return self.learned


def surprise(population: Array) -> float:
    """The least p-value of tests that a population ``(n, 2)`` is N(0, I)."""
    directions = [np.array([np.cos(a), np.sin(a)]) for a in np.linspace(0.0, np.pi, 6, endpoint=False)]
    p_values = [stats.kstest(population @ a, "norm").pvalue for a in directions]
    p_values.append(stats.kstest((population**2).sum(axis=1), "chi2", args=(2,)).pvalue)
    return float(min(p_values))


@pytest.mark.parametrize("refresh_rate", [0.01, 0.3])
@pytest.mark.parametrize("diagonal", [False, True])
def test_importance_mixing_keeps_the_search_distribution(refresh_rate: float, diagonal: bool) -> None:
    stretch = np.array([0.7, 1.2]) if diagonal else STRETCH
    search = Marching(SHIFT, stretch, refresh_rate=refresh_rate)
    populations = search.march(6)
    assert [len(p) for p in populations] == [8000] * 6
    assert min(surprise(p) for p in populations) > 1e-4
    assert 0.2 < search.evaluations / (6 * 8000) < 0.8  # some are kept and some are new


def no_second_step(
    n: int, shift: Array, stretch: Array, log_volume: float, eta: float, rng: np.random.Generator
) -> Array:
    return rng.standard_normal((n, len(shift)))


def no_refresh_in_step_two(
    n: int, shift: Array, stretch: Array, log_volume: float, eta: float, rng: np.random.Generator
) -> Array:
    return np.asarray(renew(n, shift, stretch, log_volume, 0.0, rng))


def no_refresh_in_step_one(log_ratio: Array, refresh_rate: float, rng: np.random.Generator) -> Array:
    return np.asarray(keep(log_ratio, 0.0, rng))


def keeping_regardless(log_ratio: Array, refresh_rate: float, rng: np.random.Generator) -> Array:
    return np.asarray(rng.random(len(log_ratio)) < 0.5)


def upside_down(log_ratio: Array, refresh_rate: float, rng: np.random.Generator) -> Array:
    return np.asarray(keep(-log_ratio, refresh_rate, rng))


keep, renew = importance_mixing.keep, importance_mixing.renew


@pytest.mark.parametrize(
    ("step", "wrong"),
    [
        ("renew", no_second_step),
        ("renew", no_refresh_in_step_two),
        ("keep", no_refresh_in_step_one),
        ("keep", keeping_regardless),
        ("keep", upside_down),
    ],
)
def test_the_check_of_the_distribution_notices_a_wrong_step(
    step: str, wrong: Callable[..., Array], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importance_mixing, step, wrong)
    assert min(surprise(p) for p in Marching(SHIFT, STRETCH, refresh_rate=0.3).march(4)) < 1e-6


def renewed_plainly(
    n: int, shift: Array, stretch: Array, log_volume: float, eta: float, rng: np.random.Generator
) -> Array:
    """Step two of section 4.5, a round of draws at a time."""
    accepted = np.zeros((0, len(shift)))
    while len(accepted) < n:
        y = rng.standard_normal((max(4 * (n - len(accepted)), 64), len(shift)))
        old = shift + (y * stretch if stretch.ndim == 1 else y @ stretch.T)
        new_over_old = np.exp(0.5 * ((old**2).sum(axis=1) - (y**2).sum(axis=1)) - log_volume)
        accepted = np.concatenate([accepted, y[rng.random(len(y)) < np.maximum(eta, 1.0 - 1.0 / new_over_old)]])
    return accepted[:n]


@pytest.mark.parametrize("diagonal", [False, True])
@pytest.mark.parametrize(("n", "d"), [(1, 1), (1, 15), (40, 3), (200, 15)])
def test_the_second_step_is_that_of_section_45_number_by_number(n: int, d: int, diagonal: bool) -> None:
    rng = np.random.default_rng(n + d)
    shift, stretch = 0.2 * rng.standard_normal(d), np.exp(0.1 * rng.standard_normal(d))
    if not diagonal:
        stretch = np.diag(stretch) + 0.05 * rng.standard_normal((d, d))
    volume = float(np.log(stretch).sum() if diagonal else np.linalg.slogdet(stretch)[1])
    compiled, plain = (
        step(n, shift, stretch, volume, 0.05, np.random.default_rng(1)) for step in (renew, renewed_plainly)
    )
    np.testing.assert_array_equal(compiled, plain)


def test_points_that_stay_are_the_same_points() -> None:
    search = Marching(SHIFT, STRETCH)
    first = search.ask()
    search.tell(first, np.arange(8000.0))
    second = search.ask()
    search.tell(second, np.arange(8000.0, 8000.0 + len(second)))
    here = search.mean - search.factor @ np.linalg.solve(STRETCH, SHIFT)  # the mean before the last step
    factor = search.factor @ np.linalg.inv(STRETCH)
    kept = search.state_dict()
    population = here + kept["kept_local"] @ factor.T
    np.testing.assert_allclose(population[: len(second)], second, rtol=0, atol=1e-9)
    stayed = kept["kept_fitness"][len(second) :].astype(int)  # their fitness is their number
    assert len(stayed) == 8000 - len(second)
    np.testing.assert_allclose(population[len(second) :], first[stayed], rtol=0, atol=1e-9)


def test_all_are_never_kept() -> None:
    for seed in range(20):
        stays = importance_mixing.keep(np.full(50, 100.0), 1e-12, np.random.default_rng(seed))
        assert stays.sum() == 49
    still = Marching(np.zeros(2), np.eye(2), refresh_rate=1e-3)
    still.march(2)
    assert still.evaluations > 8000


def test_a_refresh_rate_of_one_renews_everything() -> None:
    search = Marching(np.zeros(2), np.eye(2), refresh_rate=1.0)
    search.march(3)
    assert search.evaluations == 3 * 8000


@pytest.mark.parametrize("refresh_rate", [0.1, 0.5])
def test_where_nothing_moves_the_refresh_rate_is_the_part_renewed(refresh_rate: float) -> None:
    search = Marching(np.zeros(2), np.eye(2), refresh_rate=refresh_rate)
    search.march(5)
    assert (search.evaluations - 8000) / (4 * 8000) == pytest.approx(refresh_rate, abs=0.01)


def test_old_points_stay_with_the_chance_of_section_45() -> None:
    ratios = np.array([0.01, 0.5, 1.0, 1.2, 5.0, np.inf])
    with np.errstate(divide="ignore"):
        log_ratios = np.tile(np.log(ratios), 20_000)
    stays = importance_mixing.keep(log_ratios, 0.2, np.random.default_rng(0)).reshape(-1, 6).mean(axis=0)
    np.testing.assert_allclose(stays, np.minimum(1.0, 0.8 * ratios), atol=0.012)


def test_far_from_the_old_distribution_everything_is_new() -> None:
    search = Marching(np.full(2, 1e3), np.eye(2) * 1e-3)
    search.march(3)
    assert search.evaluations == 3 * 8000


@pytest.mark.parametrize("rate", [0.0, -0.1, 1.1, np.nan])
def test_a_refresh_rate_out_of_range_is_refused(rate: float) -> None:
    with pytest.raises(ValueError, match="refresh_rate"):
        NES(np.zeros(2), 1.0, refresh_rate=rate)


@pytest.mark.parametrize("name", ["Sphere", "Ellipsoid"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_nes_reuses_two_thirds_and_needs_a_third_of_the_evaluations(name: str, seed: int) -> None:
    function = rotated_and_shifted(FUNCTIONS[name], 5, seed)

    def run(mixing: bool) -> Search:
        search = NES(np.zeros(5), 1.0, importance_mixing=mixing, seed=seed, target=-1e-10, max_evaluations=30_000)
        assert "target" in search.maximize(lambda x: -float(function(x))).stop
        return search

    mixed, fresh = run(True), run(False)
    assert mixed.evaluations < mixed.generations * mixed.population / 3
    assert fresh.evaluations == fresh.generations * fresh.population
    assert 3 * mixed.evaluations < fresh.evaluations
