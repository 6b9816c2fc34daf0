"""Points told in place of those asked: their direction counts, their length does not."""

from __future__ import annotations

import numpy as np
import pytest

from dpsearch.search.injection import local_coordinates, reach, which
from tests.support.searches import SEARCHES, generation

NAMES = sorted(set(SEARCHES) - {"restarts"})
FACTOR = np.array([[2.0, 0.0, 0.5], [0.1, 1e-3, 0.0], [0.0, 3.0, 10.0]])
MEAN = np.array([1.0, 1e6, -3.0])


@pytest.mark.parametrize("factor", [FACTOR, np.array([2.0, 1e-3, 10.0])])
def test_near_points_are_located_exactly_and_far_ones_in_their_direction(factor: np.ndarray) -> None:
    y = np.random.default_rng(0).standard_normal((40, 3))
    root = factor if factor.ndim == 2 else np.diag(factor)
    y *= np.minimum(1.0, 0.99 * reach(3) / np.linalg.norm(y, axis=1, keepdims=True))
    np.testing.assert_allclose(local_coordinates(MEAN + y @ root.T, MEAN, factor), y, rtol=0, atol=1e-5)
    far = local_coordinates(MEAN + 1e8 * y @ root.T, MEAN, factor)
    np.testing.assert_allclose(np.linalg.norm(far, axis=1), reach(3), rtol=1e-12)
    np.testing.assert_allclose(far / reach(3), y / np.linalg.norm(y, axis=1, keepdims=True), rtol=0, atol=1e-6)


@pytest.mark.parametrize("place", [1e300, -1.7e308, 0.0])
@pytest.mark.parametrize("width", [1e-100, 1.0, 1e100])
def test_no_point_is_out_of_reach(place: float, width: float) -> None:
    for factor in (width * np.eye(2), width * np.ones(2), np.diag([width, 0.0])):
        local = local_coordinates(np.full((3, 2), place), np.array([1e308, 0.0]), factor)
        assert (np.linalg.norm(local, axis=1) <= reach(2) * (1.0 + 1e-9)).all()


def test_points_asked_are_recognised_in_any_order() -> None:
    asked = np.random.default_rng(0).standard_normal((4, 2))
    assert which(np.array([asked[2], asked[0], asked[0], asked[1] + 1e-16 + 1.0]), asked).tolist() == [2, 0, 0, -1]


@pytest.mark.parametrize("name", NAMES)
def test_the_order_of_points_told_does_not_matter(name: str) -> None:
    search, shuffled = (SEARCHES[name](np.ones(3), 0.5, seed=0) for _ in range(2))
    for _ in range(3):
        points = search.ask()
        order = np.random.default_rng(1).permutation(len(points))
        fitness = -((points - 0.3) ** 2).sum(axis=1)
        shuffled.ask()
        search.tell(points, fitness)
        shuffled.tell(points[order], fitness[order])
        np.testing.assert_allclose(shuffled.mean, search.mean, rtol=0, atol=1e-9)
        np.testing.assert_allclose(shuffled.stds, search.stds, rtol=1e-6)
        shuffled.load_state_dict(search.state_dict())


@pytest.mark.parametrize("name", NAMES)
def test_how_far_a_far_point_is_does_not_matter(name: str) -> None:
    near, far = (SEARCHES[name](np.zeros(3), 0.5, seed=0) for _ in range(2))
    for g in range(4):
        points = near.ask()
        fitness = -((points - 0.3) ** 2).sum(axis=1)
        if g == 2:
            fitness[0] = 1.0
            near.tell(np.vstack([near.mean + 1e3, points[1:]]), fitness)
            far.tell(np.vstack([far.mean + 1e9, far.ask()[1:]]), fitness)
            assert (near.stds < 100 * 0.5).all()
        else:
            near.tell(points, fitness)
            far.tell(far.ask(), fitness)
    np.testing.assert_allclose(near.mean, far.mean, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(near.stds, far.stds, rtol=1e-6)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("dimension", [2, 5])
def test_a_search_goes_on_with_points_taken_into_a_box(name: str, dimension: int) -> None:
    search = SEARCHES[name](np.full(dimension, 0.5), 0.5, seed=0, max_evaluations=1500)
    optimum = np.linspace(-0.2, 0.8, dimension)  # outside of the box along some axes
    while not search.stop():
        points = np.clip(search.ask(), 0.0, 1.0)
        search.tell(points, -((points - optimum) ** 2).sum(axis=1))
    assert search.best.fitness > -((np.clip(optimum, 0.0, 1.0) - optimum) ** 2).sum() - 0.1


@pytest.mark.parametrize("name", NAMES)
def test_an_injected_optimum_is_taken_up(name: str) -> None:
    search = SEARCHES[name](np.zeros(4), 0.1, seed=0)
    for g in range(400):
        points = search.ask()
        if g % 2 == 0:
            points[0] = 3.0
        search.tell(points, -((points - 3.0) ** 2).sum(axis=1))
    assert np.linalg.norm(search.mean - 3.0) < 2.0
    assert (search.stds < 100.0).all()
    generation(search)
