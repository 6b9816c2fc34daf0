"""SNES against the formulas of Wierstra et al. 2014, written out."""

from __future__ import annotations

import numpy as np
import pytest

from dpsearch.search import SNES, XNES
from tests.search.test_xnes import written_utilities
from tests.support.searches import normals, valley


def test_snes_is_the_papers_algorithm() -> None:
    mu, sigma = np.array([1.0, -2.0, 0.5]), np.array([1.0, 0.5, 2.0])
    search = SNES(mu, sigma, learning_rate=0.9, population=12, seed=3)
    rate = (3 + np.log(3)) / (5 * np.sqrt(3))
    for g in range(25):
        s = normals(3, g, 12, 3)
        z = mu + sigma * s
        np.testing.assert_allclose(search.ask(), z, rtol=0, atol=1e-10)
        fitness = np.array([-valley(z_k) for z_k in z])
        u = written_utilities(fitness)
        mu = mu + 0.9 * sigma * sum(u[k] * s[k] for k in range(12))
        sigma = sigma * np.exp(rate / 2 * sum(u[k] * (s[k] ** 2 - 1) for k in range(12)))
        search.tell(search.ask(), fitness)
        np.testing.assert_allclose(search.mean, mu, rtol=0, atol=1e-10)
        np.testing.assert_allclose(search.stds, sigma, rtol=0, atol=1e-10)


def test_in_one_dimension_snes_is_xnes_of_the_same_rates() -> None:
    snes, xnes = SNES([2.0], 1.0, sigma_learning_rate=0.5, seed=1), XNES([2.0], 1.0, sigma_learning_rate=0.5, seed=1)
    for _ in range(20):
        np.testing.assert_allclose(snes.ask(), xnes.ask(), rtol=0, atol=1e-12)
        for search in (snes, xnes):
            search.tell(search.ask(), -(search.ask()[:, 0] ** 2))


def test_it_is_fit_for_many_dimensions() -> None:
    search = SNES(np.ones(2000), 1.0, seed=0, population=10)
    search.tell(search.ask(), -(search.ask() ** 2).sum(axis=1))
    assert search.factor.shape == (2000,)
    assert (search.stds > 0).all()


@pytest.mark.parametrize("rate", ["learning_rate", "sigma_learning_rate"])
def test_learning_rates_that_are_not_positive_are_refused(rate: str) -> None:
    with pytest.raises(ValueError, match=f"^{rate} must be positive"):
        SNES(np.zeros(2), 1.0, **{rate: -1.0})
