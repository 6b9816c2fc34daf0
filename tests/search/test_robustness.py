"""Whatever a caller does with points and fitness, a search keeps finite numbers, and comes to an end or further."""

from __future__ import annotations

import warnings

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dpsearch.search import Search
from tests.support.searches import SEARCHES, Array

GENERATIONS = 25


def repaired(points: Array, how: str, generator: np.random.Generator, scale: float) -> Array:
    """Points to be told in place of those asked."""
    if how == "clipped":
        return np.clip(points, -0.3 * scale, 0.2 * scale)
    if how == "rounded":
        return np.round(points / scale) * scale
    if how == "injected":
        points[0] = 1e3 * scale
    if how == "far":
        points[-1] = 1e300
    if how == "duplicated":
        points[:] = points[0]
    if how == "some duplicated":
        points[len(points) // 2 :] = points[0]
    if how == "permuted":
        points = generator.permutation(points)
    return points


REPAIRS = ("none", "clipped", "rounded", "injected", "far", "duplicated", "some duplicated", "permuted")


def fitness_of(points: Array, kind: str, generator: np.random.Generator, scale: float) -> Array:
    """Fitness ``(n,)`` of points, of one of the awkward kinds."""
    bowl = -((points / scale - 0.5) ** 2).sum(axis=1) if np.abs(points).max() < 1e100 * scale else -points[:, 0]
    some = generator.random(len(points)) < 0.4
    kinds: dict[str, Array] = {
        "bowl": bowl,
        "offset": bowl + 100.0,
        "linear": points[:, 0],
        "constant": np.full(len(points), 7.0),
        "nan": np.full(len(points), np.nan),
        "some nan": np.where(some, np.nan, bowl),
        "infinite": np.where(some, np.inf, bowl),
        "huge": np.clip(bowl, -1e8, 1e8) * 1.7e300,
        "tiny": bowl * 1e-310,
        "integers": np.floor(bowl),
        "noise": generator.standard_normal(len(points)),
        "reversed": -bowl,
    }
    return kinds[kind]


KINDS = (
    "bowl",
    "offset",
    "linear",
    "constant",
    "nan",
    "some nan",
    "infinite",
    "huge",
    "tiny",
    "integers",
    "noise",
    "reversed",
)


@settings(max_examples=150, deadline=None)
@given(
    name=st.sampled_from(sorted(SEARCHES)),
    dimension=st.integers(1, 6),
    scale=st.sampled_from([1e-50, 1e-8, 1.0, 1e8, 1e50]),
    offset=st.sampled_from([0.0, 1.0, -1e6, 1e12]),
    repair=st.sampled_from(REPAIRS),
    kind=st.sampled_from(KINDS),
    seed=st.integers(0, 2**64 - 1),
)
def test_no_points_and_no_fitness_upset_a_search(
    name: str, dimension: int, scale: float, offset: float, repair: str, kind: str, seed: int
) -> None:
    generator = np.random.default_rng(seed)
    search = SEARCHES[name](np.full(dimension, offset * scale), scale, seed=seed, max_evaluations=10**4)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "NaN or infinite fitness")
        while not search.stop() and search.generations < GENERATIONS:
            points = repaired(search.ask(), repair, generator, scale)
            search.tell(points, fitness_of(points, kind, generator, scale))
            check(search)


def check(search: Search) -> None:
    """All numbers are finite, but that of a best fitness which there is not yet."""
    assert np.isfinite(search.mean).all()
    assert np.isfinite(search.stds).all()
    assert (search.stds > 0.0).all()
    assert np.isfinite(search.ask()).all()
    assert np.isfinite(search.best.fitness) or search.best.x is None
