"""FEM against algorithm 5.1 with dense matrices, and in batches against NumPy's weighted mean and covariance."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dpsearch.search import FEM
from tests.support.searches import Array, evaluated, normals, valley


class Algorithm51:
    """The pseudocode with a dense covariance; samples are given, since any root of Sigma may draw them."""

    def __init__(self, x: Array, sigma: Array, alpha: float, N: int, m: int, expansion: float, elitist: bool) -> None:
        self.x, self.sigma, self.alpha, self.N, self.m, self.expansion = x, sigma, alpha, N, m, expansion
        self.alpha_sigma, self.centre = alpha, "new"  # not so in the defaults, which go beyond the pseudocode
        self.elitist, self.best, self.last = elitist, -np.inf, list[float]()

    def u(self, fitness: float) -> float:
        if len(self.last) == self.N:
            keep_oldest = self.elitist and self.last[0] == self.best
            self.last.pop(1 if keep_oldest else 0)
        self.last.append(fitness)
        self.best = max(self.best, fitness)
        place = sorted(self.last, reverse=True).index(fitness)  # 0 for the best
        return max(0.0, (self.m - place) / self.m) if len(self.last) == self.N else 0.0

    def update(self, z: Array, fitness: float) -> None:
        u, old = self.u(fitness), self.x
        w, v = self.alpha * u, self.alpha_sigma * u
        self.x = (1 - w) * self.x + w * z
        x = self.x if self.centre == "new" else old
        self.sigma = (1 - v) * self.sigma + self.expansion * v * np.outer(x - z, x - z)


@pytest.mark.parametrize("elitist", [False, True])
@pytest.mark.parametrize("expansion", [1.0, 1.2])
@pytest.mark.parametrize("covariance", ["full", "diagonal"])
@pytest.mark.parametrize(("alpha_sigma", "centre"), [(0.3, "new"), (0.1, "new"), (0.3, "old"), (None, "old")])
def test_online_fem_is_algorithm_51(
    elitist: bool, expansion: float, covariance: str, alpha_sigma: float | None, centre: str
) -> None:
    x0, sigma0 = np.array([1.0, -0.5, 2.0]), np.array([0.5, 1.0, 2.0])
    settings: dict[str, Any] = {"forget_factor": 0.3, "window": 10, "top": 4}
    settings |= {"covariance_forget_factor": alpha_sigma, "centre": centre}
    search = FEM(x0, sigma0, elitist=elitist, expansion=expansion, covariance=covariance, seed=7, **settings)
    twin = Algorithm51(x0, np.diag(sigma0**2), 0.3, 10, 4, expansion, elitist)
    twin.alpha_sigma, twin.centre = alpha_sigma or 0.5 / 3, centre
    for k in range(150):
        root = search.factor if covariance == "full" else np.diag(search.factor)
        z = search.ask()
        np.testing.assert_allclose(z[0], search.mean + root @ normals(7, k, 1, 3)[0], rtol=0, atol=1e-12)
        fitness = -valley(z[0])
        twin.update(z[0], fitness)
        if covariance == "diagonal":
            twin.sigma = np.diag(np.diag(twin.sigma))
        search.tell(z, [fitness])
        np.testing.assert_allclose(search.mean, twin.x, rtol=0, atol=1e-9)
        root = search.factor if covariance == "full" else np.diag(search.factor)
        np.testing.assert_allclose(root @ root.T, twin.sigma, rtol=0, atol=1e-9)
    assert np.abs(search.mean - x0).max() > 0.5


def test_nothing_is_learned_before_the_window_is_full() -> None:
    search = FEM(np.ones(2), 1.0, window=5, top=5, seed=0)
    evaluated(search, 4)
    np.testing.assert_array_equal(search.mean, [1.0, 1.0])
    evaluated(search, 1)
    assert (search.mean != 1.0).all()


def utilities(window: int, top: int, fitness: list[float], elitist: bool = False) -> list[float]:
    """What each of these is given, read from how far it pulls the mean at forget factor 1/2."""
    search = FEM([0.0], 1.0, window=window, top=top, forget_factor=0.5, elitist=elitist, seed=0)
    given = []
    for f in fitness:
        search.ask()
        before = search.mean[0]
        search.tell([[before + 1.0]], [f])
        given.append(2.0 * (search.mean[0] - before))
    return given


def test_the_newest_is_ranked_among_the_last() -> None:
    found = utilities(4, 2, [1.0, 2.0, 3.0, 4.0, 3.5, 3.2, 3.3, 3.1, 3.25, 0.0])
    np.testing.assert_allclose(found, [0, 0, 0, 1, 0.5, 0, 0, 0, 0.5, 0], atol=1e-12)


def test_an_elitist_window_keeps_the_best_until_a_better_comes() -> None:
    rising = [9.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 10.0, 7.0, 8.0, 9.0]
    np.testing.assert_allclose(utilities(3, 1, rising), [0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(utilities(3, 1, rising, elitist=True), [0] * 7 + [1, 0, 0, 0], atol=1e-12)


@pytest.mark.parametrize("elitist", [False, True])
def test_in_a_window_of_one_every_sample_is_the_best(elitist: bool) -> None:
    np.testing.assert_allclose(utilities(1, 1, [3.0, 2.0, 1.0], elitist), 1.0)


def test_equal_fitness_gets_the_middle_rank() -> None:
    np.testing.assert_allclose(utilities(3, 3, [1.0, 1.0, 1.0, 1.0]), [0, 0, 2 / 3, 2 / 3], atol=1e-12)
    np.testing.assert_allclose(utilities(9, 2, [1.0] * 12), 0.0, atol=1e-12)  # a plateau


def test_a_sample_at_the_mean_narrows_the_distribution() -> None:
    search = FEM(np.ones(2), 2.0, window=1, top=1, forget_factor=0.5, covariance_forget_factor=0.5, seed=0)
    search.ask()
    search.tell([[1.0, 1.0]], [0.0])
    np.testing.assert_allclose(search.factor, np.sqrt(2.0) * np.eye(2), rtol=1e-12)


def batch(forget_factor: float, **options: Any) -> tuple[FEM, Array, Array, Array, Array]:
    """A batch search after one generation, its points and their utilities, and its mean and covariance before."""
    options = {"population": 12, "top": 6, "seed": 1, "centre": "new", **options}
    search = FEM(np.ones(3), np.array([1.0, 0.5, 2.0]), online=False, forget_factor=forget_factor, **options)
    evaluated(search, 1)
    before = search.factor if search.diagonal else search.factor @ search.factor.T
    mean, z = search.mean, search.ask()
    fitness = np.array([-valley(x) for x in z])
    search.tell(z, fitness)
    u = np.array([max(0.0, 1 - (fitness > f).sum() / options["top"]) for f in fitness])
    return search, z, u, mean, before


def test_a_batch_is_fitted_by_its_weighted_mean_and_covariance() -> None:
    search, z, u, _, _ = batch(1.0)
    np.testing.assert_allclose(search.mean, np.average(z, axis=0, weights=u), rtol=1e-10)
    covariance = np.cov(z.T, aweights=u, ddof=0)
    np.testing.assert_allclose(search.factor @ search.factor.T, covariance, rtol=0, atol=1e-12)
    assert search.repairs == 0


@pytest.mark.parametrize("expansion", [1.0, 1.3])
@pytest.mark.parametrize(("alpha_sigma", "centre"), [(None, "new"), (0.2, "new"), (0.4, "old"), (0.2, "old")])
def test_a_batch_forgets_like_algorithm_51(expansion: float, alpha_sigma: float | None, centre: str) -> None:
    options = {"expansion": expansion, "covariance_forget_factor": alpha_sigma, "centre": centre}
    search, z, u, mean, before = batch(0.4, **options)
    w, v = u / u.sum(), alpha_sigma or 0.4
    new = 0.6 * mean + 0.4 * w @ z
    np.testing.assert_allclose(search.mean, new, rtol=1e-10)
    x = mean if centre == "old" else new
    covariance = (1 - v) * before + expansion * v * sum(w[k] * np.outer(z[k] - x, z[k] - x) for k in range(12))
    np.testing.assert_allclose(search.factor @ search.factor.T, covariance, rtol=0, atol=1e-12)


def test_a_batch_with_diagonal_covariance_fits_each_axis() -> None:
    search, z, u, mean, stds = batch(0.4, covariance="diagonal")
    w = 0.4 * u / u.sum()
    new = 0.6 * mean + w @ z
    np.testing.assert_allclose(search.mean, new, rtol=1e-10)
    np.testing.assert_allclose(search.stds**2, 0.6 * stds**2 + w @ (z - new) ** 2, rtol=1e-10)


@pytest.mark.parametrize("covariance", ["full", "diagonal"])
def test_a_batch_that_does_not_span_the_space_is_repaired_and_counted(covariance: str) -> None:
    search = FEM(np.zeros(4), 1.0, online=False, covariance=covariance, forget_factor=1.0, centre="new", top=1, seed=0)
    evaluated(search, 1)  # one point alone has a utility: no variance at all
    assert search.repairs == 1
    np.testing.assert_allclose(search.stds, 1e-6, rtol=1e-6)
    assert np.isfinite(search.ask()).all()


@pytest.mark.parametrize(
    ("argument", "options"),
    [
        ("covariance", {"covariance": "spherical"}),
        ("forget_factor", {"forget_factor": 0.0}),
        ("forget_factor", {"forget_factor": 1.5}),
        ("forget_factor", {"forget_factor": np.nan}),
        ("covariance_forget_factor", {"covariance_forget_factor": 0.0}),
        ("covariance_forget_factor", {"covariance_forget_factor": 1.0}),
        ("centre", {"centre": "median"}),
        ("top", {"top": 0}),
        ("top", {"top": 51}),
        ("top", {"top": 13, "online": False, "population": 12}),
        ("window", {"window": 0}),
        ("expansion", {"expansion": 0.0}),
        ("population", {"population": 10}),
        ("importance_mixing", {"importance_mixing": True}),
    ],
)
def test_an_argument_out_of_range_is_named(argument: str, options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=argument):
        FEM(np.zeros(3), 1.0, **options)


@pytest.mark.parametrize("d", [1, 2, 10])
def test_the_defaults_suit_every_dimension(d: int) -> None:
    assert FEM(np.zeros(d), 1.0).covariance_forget_factor == min(0.2, 0.5 / d)
    assert FEM(np.zeros(d), 1.0, online=False).covariance_forget_factor == 0.5
    assert FEM(np.zeros(d), 1.0, online=False).top == 15 * d // 2
    assert FEM(np.zeros(d), 1.0).top == 5
    assert FEM(np.zeros(d), 1.0, window=3).top == 3


def test_a_batch_of_one_is_refused_as_it_cannot_be_ranked() -> None:
    with pytest.raises(ValueError, match=r"^population must be a whole number, at least 2, got 1$"):
        FEM(np.zeros(2), 1.0, online=False, population=1)
