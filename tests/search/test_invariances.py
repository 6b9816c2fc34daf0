"""What must not change a search: where the origin is, how the axes lie, and how fitness is measured."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dpsearch.search import FEM, NES, XNES, Search
from dpsearch.search.gaussian import GaussianSearch
from tests.support.searches import SEARCHES, Array, Maker, evaluated, rotation, valley

X0 = np.array([1.0, -0.5, 0.25])
ROTATABLE: dict[str, Maker] = {
    name: make for name, make in SEARCHES.items() if name not in {"cmaes", "restarts", "snes", "snes-mixing"}
}
del ROTATABLE["fem-diagonal"]
SCALABLE = {name: make for name, make in SEARCHES.items() if name != "cmaes"}  # cma perturbs the initial axes


def generations(name: str) -> int:
    return 60 if name in {"fem", "fem-elitist", "fem-diagonal"} else 15


def gaussian(make: Maker, *args: Any, **options: Any) -> GaussianSearch:
    search = make(*args, **options)
    assert isinstance(search, GaussianSearch)
    return search


@pytest.mark.parametrize("name", SEARCHES)
def test_an_order_preserving_transformation_of_fitness_changes_no_bit(name: str) -> None:
    def run(transform: Callable[[float], float]) -> tuple[Array, list[float]]:
        search, seen, points = SEARCHES[name](X0, 0.5, seed=4), list[float](), list[Array]()
        for _ in range(generations(name)):
            asked = search.ask()
            fitness = [-valley(x) for x in asked]
            search.tell(asked, [transform(f) for f in fitness])
            points.append(asked)
            seen += fitness
        return np.concatenate(points), seen

    plain, fitness = run(lambda f: f)
    order = np.argsort(fitness)
    transforms: list[Callable[[float], float]] = [lambda f: 1e6 + 1e3 * f, lambda f: f**3, lambda f: -math.log1p(-f)]
    for transform in transforms:
        transformed = np.array([transform(f) for f in fitness])
        assert (np.diff(transformed[order]) > 0).all()  # or it is not one that preserves the order
        np.testing.assert_array_equal(run(transform)[0], plain)


@pytest.mark.parametrize("name", SEARCHES)
def test_a_translation_moves_every_evaluation_alike(name: str) -> None:
    c = np.array([3.0, -2.0, 0.125])
    here = evaluated(SEARCHES[name](X0, 0.5, seed=4), generations(name))
    there = evaluated(SEARCHES[name](X0 + c, 0.5, seed=4), generations(name), lambda x: valley(x - c))
    np.testing.assert_allclose(there - c, here, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", SCALABLE)
def test_units_of_the_axes_do_not_matter(name: str) -> None:
    units = np.array([0.25, 1.0, 30.0])
    here = evaluated(SEARCHES[name](X0, 0.5, seed=4), generations(name))
    there = evaluated(SEARCHES[name](X0 * units, 0.5 * units, seed=4), generations(name), lambda x: valley(x / units))
    np.testing.assert_allclose(there / units, here, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ROTATABLE)
def test_a_rotation_of_fitness_and_search_distribution_rotates_every_evaluation(name: str) -> None:
    q = rotation(3)
    upright, rotated = (gaussian(ROTATABLE[name], X0, 0.5, seed=4) for _ in range(2))
    rotated.load_state_dict({**rotated.state_dict(), "mean": q @ X0, "factor": q @ rotated.factor})
    here = evaluated(upright, generations(name))
    there = evaluated(rotated, generations(name), lambda x: valley(q.T @ x))
    np.testing.assert_allclose(there @ q, here, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", sorted(set(ROTATABLE) - {"nes-additive"}))
def test_rotated_samples_give_the_rotated_step(name: str) -> None:
    q, rng = rotation(3), np.random.default_rng(6)

    def step(turn: Array) -> tuple[Array, Array]:
        search = gaussian(ROTATABLE[name], X0, 0.5, seed=4)
        evaluated(search, 8)  # fills a window, if there is one
        n = 1 if len(search.ask()) == 1 and isinstance(search, FEM) else search.population
        return search._step(local[:n] @ turn, np.full(n, 1.0) if n == 1 else fitness[:n])

    local, fitness = rng.standard_normal((60, 3)), rng.standard_normal(60)
    shift, stretch = step(np.eye(3))
    turned_shift, turned_stretch = step(q)
    np.testing.assert_allclose(turned_shift, shift @ q, rtol=0, atol=1e-10)
    np.testing.assert_allclose(turned_stretch, q.T @ stretch @ q, rtol=0, atol=1e-10)
    assert np.linalg.norm(shift) > 0.01


def test_the_additive_update_follows_a_rotation_to_first_order_only() -> None:
    q, rng = rotation(3), np.random.default_rng(6)
    local, fitness = rng.standard_normal((45, 3)), rng.standard_normal(45)
    gaps = []
    for rate in (1e-2, 1e-3):
        search = NES(X0, 0.5, update="additive", learning_rate=rate, seed=0)
        shift, stretch = search._step(local, fitness)
        turned_shift, turned_stretch = search._step(local @ q, fitness)
        np.testing.assert_allclose(turned_shift, shift @ q, rtol=0, atol=1e-12)
        gaps.append(np.abs(turned_stretch @ turned_stretch.T - q.T @ stretch @ stretch.T @ q).max())
    assert gaps[0] / gaps[1] == pytest.approx(100.0, rel=0.05)


@pytest.mark.parametrize("make", [NES, XNES])
def test_the_order_within_a_generation_does_not_matter(make: Maker) -> None:
    rng = np.random.default_rng(6)
    search = gaussian(make, X0, 0.5, seed=0)
    local, fitness, order = rng.standard_normal((45, 3)), rng.standard_normal(45), rng.permutation(45)
    shift, stretch = search._step(local, fitness)
    again = search._step(local[order], fitness[order])
    np.testing.assert_allclose(again[0], shift, rtol=0, atol=1e-12)
    np.testing.assert_allclose(again[1], stretch, rtol=0, atol=1e-12)


@pytest.mark.parametrize("sigma0", [0.3, [0.1, 1.0, 5.0]])
@pytest.mark.parametrize("name", SEARCHES)
def test_the_initial_standard_deviations_and_mean_are_those_given(name: str, sigma0: Any) -> None:
    search: Search = SEARCHES[name](X0, sigma0, seed=0)
    np.testing.assert_array_equal(search.mean, X0)
    np.testing.assert_allclose(search.stds, np.broadcast_to(sigma0, 3), rtol=1e-4 if name == "cmaes" else 1e-15)
