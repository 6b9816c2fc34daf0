"""CMAES against the ``cma`` package itself, given the same random numbers."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

from dpsearch.search import CMAES
from tests.support.searches import Array, normals, valley

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import cma


class Peer:
    """``cma.CMAEvolutionStrategy`` with the random numbers of a search of this seed."""

    def __init__(self, x0: Array, sigma0: float, seed: int, **options: Any) -> None:
        self.generation, self.seed = 0, seed
        quiet = {"verbose": -9, "verb_log": 0, "signals_filename": "", "seed": np.nan, "randn": self.randn}
        self.es = cma.CMAEvolutionStrategy(x0, sigma0, {**quiet, **options})

    def randn(self, n: int, dimension: int) -> Array:
        return normals(self.seed, self.generation, n, dimension)

    def step(self, costs: list[float], points: Array | None = None) -> None:
        self.es.tell(self.asked if points is None else list(points), costs)
        self.generation += 1

    def ask(self) -> Array:
        self.asked = self.es.ask()
        return np.array(self.asked)


def test_cmaes_is_the_package() -> None:
    search, peer = CMAES(np.ones(4), 0.5, seed=9), Peer(np.ones(4), 0.5, 9)
    for _ in range(40):
        z = peer.ask()
        np.testing.assert_array_equal(search.ask(), z)
        costs = [valley(x) for x in z]
        peer.step(costs)
        search.tell(z, [-c for c in costs])
    np.testing.assert_array_equal(search.mean, peer.es.mean)
    np.testing.assert_array_equal(search.stds, peer.es.stds)
    assert search.best.fitness == -peer.es.best.f


def test_points_told_in_place_of_those_asked_reach_the_package() -> None:
    search, peer = CMAES(np.ones(3), 0.5, seed=9), Peer(np.ones(3), 0.5, 9)
    for _ in range(10):
        z = peer.ask()
        np.testing.assert_array_equal(search.ask(), z)
        z[0] = np.clip(z[0], 0.0, 1.0)
        costs = [valley(x) for x in z]
        peer.step(costs, z)
        search.tell(z, [-c for c in costs])


def test_a_standard_deviation_for_each_axis_and_options_are_passed_on() -> None:
    sigma0 = np.array([0.5, 2.0, 1.0])
    search = CMAES(np.ones(3), sigma0, population=11, seed=1, cma_options={"CMA_active": False})
    np.testing.assert_allclose(search.stds, sigma0, rtol=1e-4)  # cma itself makes the axes differ a little
    peer = Peer(np.ones(3), 2.0, 1, popsize=11, CMA_stds=sigma0 / 2.0, CMA_active=False)
    for _ in range(10):
        z = peer.ask()
        assert z.shape == (11, 3)
        np.testing.assert_array_equal(search.ask(), z)
        peer.step([valley(x) for x in z])
        search.tell(z, [-valley(x) for x in z])


def test_invalid_fitness_is_worse_than_the_worst() -> None:
    search, peer = CMAES(np.ones(3), 0.5, seed=9, population=8), Peer(np.ones(3), 0.5, 9, popsize=8)
    z = peer.ask()
    costs = [valley(x) for x in z]
    costs[2] = max(costs[:2] + costs[3:]) + 100.0
    peer.step(costs)
    search.ask()
    with pytest.warns(UserWarning, match="NaN or infinite"):
        search.tell(z, [-c if i != 2 else np.inf for i, c in enumerate(costs)])
    np.testing.assert_array_equal(search.ask(), peer.ask())


def test_stop_gives_the_reasons_of_both() -> None:
    search = CMAES(np.ones(3), 0.5, seed=9, max_evaluations=10**5)
    reasons = search.maximize(lambda x: -float(x @ x)).stop
    assert "tolfun" in reasons
    assert CMAES(np.ones(3), 0.5, seed=9).stop() == {}


def test_an_option_unknown_to_the_package_is_named() -> None:
    with pytest.raises(ValueError, match="nonsense"):
        CMAES(np.ones(3), 0.5, cma_options={"nonsense": 1})


def test_random_numbers_asked_for_twice_in_a_generation_differ() -> None:
    search = CMAES(np.ones(3), 0.5, seed=9)
    search.ask()
    draw = search.es.opts["randn"]
    assert (draw(1, 3) != draw(1, 3)).all()


def test_wrong_options_are_refused_on_one_line() -> None:
    for options in ({"nonsense": 1}, 3, {"popsize": 5}):
        with pytest.raises(ValueError, match=r"^cma_options must [^\n]*$"):
            CMAES(np.ones(3), 0.5, cma_options=options)  # type: ignore[arg-type]


@pytest.mark.parametrize("level", [1e16, 1e300, -1e300])
def test_invalid_fitness_is_the_worst_among_large_values_too(level: float) -> None:
    search, peer = (CMAES(np.ones(3), 0.5, seed=9, population=8) for _ in range(2))
    fitness = level * (1.0 + np.arange(8.0) / 8)
    broken = fitness.copy()
    worst = int(fitness.argmin())
    broken[worst] = np.nan
    search.ask()
    with pytest.warns(UserWarning, match="NaN or infinite"):
        search.tell(search.ask(), broken)
    peer.tell(peer.ask(), np.argsort(np.argsort(fitness)).astype(float))
    if abs(level) < 1e150:  # beyond, all are as good
        np.testing.assert_array_equal(search.ask(), peer.ask())
    assert np.isfinite(search.ask()).all()
