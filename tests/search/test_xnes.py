"""XNES against the formulas of Glasmachers et al. 2010 and Wierstra et al. 2014, written out."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import linalg, stats

from dpsearch.search import XNES
from dpsearch.search.xnes import mann_whitney, matrix_exponential
from tests.support.searches import Array, normals, valley


def written_utilities(fitness: Array) -> Array:
    n = len(fitness)
    raw: list[float] = [max(0.0, np.log(n / 2 + 1) - np.log(1 + sum(other > f for other in fitness))) for f in fitness]
    return np.asarray(np.array(raw) / sum(raw) - 1 / n, np.float64)


class WrittenXNES:
    """mu, sigma and B with det B = 1, as in the paper; z = mu + sigma B s."""

    def __init__(self, mu: Array, A: Array, rate: float, shape_rate: float) -> None:
        d = len(mu)
        self.mu, self.sigma, self.B = mu, np.linalg.det(A) ** (1 / d), A / np.linalg.det(A) ** (1 / d)
        self.rate, self.shape_rate = rate, shape_rate
        self.bolder = self.density(self.sigma)

    def density(self, sigma: float) -> Any:
        return stats.multivariate_normal(self.mu, sigma**2 * self.B @ self.B.T)

    def draw(self, s: Array) -> Array:
        return np.array([self.mu + self.sigma * self.B @ s_k for s_k in s])

    def update(self, s: Array, fitness: Array) -> None:
        u, d = written_utilities(fitness), len(self.mu)
        g_delta = sum(u_k * s_k for u_k, s_k in zip(u, s, strict=True))
        g_m = sum(u_k * (np.outer(s_k, s_k) - np.eye(d)) for u_k, s_k in zip(u, s, strict=True))
        g_sigma = np.trace(g_m) / d
        g_b = g_m - g_sigma * np.eye(d)
        before = self.sigma
        self.mu = self.mu + self.sigma * self.B @ g_delta
        self.sigma = before * np.exp(self.rate / 2 * g_sigma)
        self.B = self.B @ linalg.expm(self.shape_rate / 2 * g_b)
        self.bolder = self.density(before * np.exp(1.5 * self.rate / 2 * g_sigma))

    def adapt(self, z: Array, fitness: Array, least: float) -> None:
        """Adaptation sampling: samples of this distribution, weighted as if of that of a bolder step."""
        n, d = z.shape
        w = self.bolder.pdf(z) / self.density(self.sigma).pdf(z)
        u = sum(
            w[i] * ((fitness[i] > fitness[j]) + 0.5 * (fitness[i] == fitness[j])) for i in range(n) for j in range(n)
        )
        deviation = np.sqrt(n * w.sum() * (n + w.sum() + 1) / 12)
        if stats.norm.cdf((u - n * w.sum() / 2) / deviation) < 0.5 - 1 / (3 * (d + 1)):
            self.rate = 0.9 * self.rate + 0.1 * least
        else:
            self.rate = min(1.1 * self.rate, 1.0)


def test_xnes_is_the_papers_algorithm() -> None:
    x0, sigma0 = np.array([1.0, -2.0, 0.5]), np.array([1.0, 0.5, 2.0])
    search = XNES(x0, sigma0, shape_learning_rate=0.2, population=12, seed=3)
    twin = WrittenXNES(x0, np.diag(sigma0), (9 + 3 * np.log(3)) / (5 * 3 * np.sqrt(3)), 0.2)
    for g in range(25):
        s = normals(3, g, 12, 3)
        z = twin.draw(s)
        np.testing.assert_allclose(search.ask(), z, rtol=0, atol=1e-10)
        fitness = np.array([-valley(z_k) for z_k in z])
        twin.update(s, fitness)
        search.tell(search.ask(), fitness)
        np.testing.assert_allclose(search.mean, twin.mu, rtol=0, atol=1e-10)
        np.testing.assert_allclose(search.factor, twin.sigma * twin.B, rtol=0, atol=1e-10)


def test_adaptation_sampling_is_the_papers() -> None:
    search = XNES(np.ones(3), 0.3, adaptation_sampling=True, population=20, seed=2)
    least = search.sigma_learning_rate
    twin = WrittenXNES(np.ones(3), 0.3 * np.eye(3), least, least)
    rates = [least]
    noise = np.random.default_rng(0)
    for g in range(80):
        s, z = normals(2, g, 20, 3), search.ask()
        fitness = noise.standard_normal(20)  # on which bold steps fail now and then
        if g > 0:
            twin.adapt(z, fitness, least)
        twin.update(s, fitness)
        search.tell(z, fitness)
        assert search.sigma_learning_rate == pytest.approx(twin.rate, rel=1e-9)
        rates.append(search.sigma_learning_rate)
    assert (np.diff(rates) > 0).any()
    assert (np.diff(rates) < 0).any()
    assert least <= min(rates) < max(rates) <= 1.0


def test_without_adaptation_sampling_the_rate_stays() -> None:
    search = XNES(np.ones(3), 0.3, seed=2)
    for _ in range(5):
        search.tell(search.ask(), [-valley(x) for x in search.ask()])
    assert search.sigma_learning_rate == (9 + 3 * np.log(3)) / (5 * 3 * np.sqrt(3))


def test_the_mann_whitney_test_favours_weights_on_the_fit() -> None:
    fitness = np.arange(10.0)
    assert mann_whitney(fitness, np.ones(10)) == 0.5
    assert mann_whitney(np.zeros(10), np.arange(1.0, 11.0)) == pytest.approx(0.5)
    assert mann_whitney(fitness, np.arange(1.0, 11.0)) > 0.8
    assert mann_whitney(fitness, np.arange(10.0, 0.0, -1.0)) < 0.2


def test_the_mann_whitney_test_of_whole_weights_is_that_of_repeated_samples() -> None:
    fitness, weights = np.array([3.0, 1.0, 2.0, 2.0]), np.array([1.0, 0.0, 2.0, 3.0])
    u = stats.mannwhitneyu(np.repeat(fitness, weights.astype(int)), fitness).statistic
    assert mann_whitney(fitness, weights) == pytest.approx(stats.norm.cdf((u - 12) / np.sqrt(4 * 6 * 11 / 12)))


def test_the_matrix_exponential_is_not_elementwise() -> None:
    m = np.array([[0.5, -1.0, 0.2], [-1.0, 0.3, 0.7], [0.2, 0.7, -2.0]])
    np.testing.assert_allclose(matrix_exponential(m), linalg.expm(m), rtol=0, atol=1e-13)


def test_on_a_plateau_nothing_moves() -> None:
    search = XNES(np.ones(3), 0.5, seed=0)
    for _ in range(5):
        search.tell(search.ask(), np.zeros(search.population))
    np.testing.assert_allclose(search.mean, 1.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(search.factor, 0.5 * np.eye(3), rtol=0, atol=1e-12)


@pytest.mark.parametrize("rate", ["learning_rate", "sigma_learning_rate", "shape_learning_rate"])
def test_learning_rates_that_are_not_positive_are_refused(rate: str) -> None:
    with pytest.raises(ValueError, match=f"^{rate} must be positive"):
        XNES(np.zeros(2), 1.0, **{rate: 0.0})  # type: ignore[arg-type]


def test_a_diagonal_covariance_is_left_to_snes() -> None:
    with pytest.raises(TypeError, match="diagonal"):
        XNES(np.zeros(2), 1.0, diagonal=True)
