"""Every search in the settings that matter, and small runs of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dpsearch.search import CMAES, FEM, NES, SNES, XNES, Restarts, Search

Array = NDArray[np.float64]
Maker = Callable[..., Search]

SEARCHES: dict[str, Maker] = {
    "nes": NES,
    "nes-additive": partial(NES, update="additive", importance_mixing=False, learning_rate=0.5),
    "nes-exact": partial(NES, gradient="exact", learning_rate=0.5),
    "xnes": XNES,
    "xnes-adaptive": partial(XNES, adaptation_sampling=True, importance_mixing=True),
    "snes": SNES,
    "snes-mixing": partial(SNES, importance_mixing=True, population=20),
    "fem": partial(FEM, window=8, top=3),
    "fem-elitist": partial(FEM, window=8, top=3, elitist=True, expansion=1.2),
    "fem-diagonal": partial(FEM, window=8, top=3, covariance="diagonal"),
    "fem-batch": partial(FEM, online=False, population=20, forget_factor=0.5),
    "fem-batch-mixing": partial(FEM, online=False, population=20, forget_factor=0.5, importance_mixing=True),
    "cmaes": CMAES,
    "restarts": partial(Restarts, XNES, patience=20, growth=1.5),
}
"""Makers, to be called with x0, sigma0 and options."""


def valley(x: Array) -> float:
    """A cost with correlated axes of different widths, lowest at 0."""
    return float(sum((10.0**i * (x[i] - 0.5 * x[i - 1]) ** 2 for i in range(1, len(x))), x[0] ** 2))


def generation(search: Search, cost: Callable[[Array], float] = valley) -> Array:
    """Ask and tell once: the points asked."""
    points = search.ask()
    search.tell(points, [-cost(x) for x in points])
    return points


def evaluated(search: Search, generations: int, cost: Callable[[Array], float] = valley) -> Array:
    """All points asked in some generations, ``(n, d)``."""
    return np.concatenate([generation(search, cost) for _ in range(generations)])


def normals(seed: int, generation: int, n: int, dimension: int) -> Array:
    """The normal numbers of a generation, which are a function of (seed, generation) alone."""
    philox = np.random.Philox(key=seed, counter=generation << 128)
    return np.random.Generator(philox).standard_normal((n, dimension))


def rotation(dimension: int, seed: int = 0) -> Array:
    """An orthogonal matrix."""
    return np.linalg.qr(np.random.default_rng(seed).standard_normal((dimension, dimension)))[0]
