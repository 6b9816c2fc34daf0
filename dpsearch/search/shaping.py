"""Fitness shaping: utilities by rank, so that only the order of fitness values matters (section 4.4).

Every function maps fitness ``(n,)`` to utilities ``(n,)``. Equal fitness gets equal utility, the mean utility of the
ranks it takes: on a plateau a search then stands still instead of drifting with the order of its samples.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from dpsearch.search.base import Vector


def relative_rank(fitness: Vector) -> Vector:
    """2i - 1 for the better half, else 0, where i in [0, 1] is the relative rank (section 4.4)."""
    return _by_rank(fitness, _relative_rank)


def log_rank(fitness: Vector) -> Vector:
    """max(0, ln(n/2 + 1) - ln k) for the k-th best, scaled to sum 1, minus 1/n (Glasmachers et al. 2010)."""
    return _by_rank(fitness, _log_rank)


def top_linear(fitness: Vector, m: int) -> Vector:
    """1, 1 - 1/m, .., 1/m for the best m, 0 for the others (section 5.4.2)."""
    return _by_rank(fitness, lambda n: np.clip(1.0 - np.arange(n) / m, 0.0, None))


@cache
def _relative_rank(n: int) -> Vector:
    i = 1.0 - np.arange(n) / max(n - 1, 1)
    return np.asarray(np.where(i > 0.5, 2.0 * i - 1.0, 0.0))


@cache
def _log_rank(n: int) -> Vector:
    u: Vector = np.maximum(0.0, np.log(n / 2 + 1) - np.log(np.arange(1, n + 1)))
    return np.asarray(u / u.sum() - 1.0 / n)


def _by_rank(fitness: Vector, utilities: Callable[[int], Vector]) -> Vector:
    """Hand out utilities, best first, and share them out among equals."""
    order = np.argsort(-fitness, kind="stable")
    given = utilities(len(fitness))
    ranked = fitness[order]
    differs = ranked[1:] != ranked[:-1]
    if not differs.all():
        starts = np.flatnonzero(np.r_[True, differs])  # of each group of equals
        sizes = np.diff(np.r_[starts, len(ranked)])
        given = np.repeat(np.add.reduceat(given, starts) / sizes, sizes)
    shared = np.empty(len(fitness))
    shared[order] = given
    return shared
