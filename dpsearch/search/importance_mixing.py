"""Importance mixing: keep those points of the last generation that the moved distribution might have drawn (4.5).

Two steps of rejection sampling leave a population distributed exactly as the new search distribution, in which only
the newly drawn points need to be evaluated. All is done in local coordinates, in which a distribution is N(0, I).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from dpsearch.search.base import Matrix, Vector


def keep(log_ratio: Vector, refresh_rate: float, generator: np.random.Generator) -> NDArray[np.bool_]:
    """Step one: which of the old points stay.

    Args:
        log_ratio: ``(n,)`` logarithm of new over old density at each old point.
        refresh_rate: The minimal refresh rate eta in [0, 1].
        generator: Source of randomness.

    Returns:
        ``(n,)`` True where min(1, (1 - eta) new / old) accepts. Never all: one new point comes at least, lest the
        search stand still.
    """
    chance = (1.0 - refresh_rate) * np.exp(np.minimum(log_ratio, 1.0))  # beyond 1 all are accepted anyway
    accepted: NDArray[np.bool_] = generator.random(len(chance)) < chance
    if accepted.all():
        accepted[generator.integers(len(accepted))] = False
    return accepted


def renew(
    n: int,
    dimension: int,
    log_ratio: Callable[[Matrix], Vector],
    refresh_rate: float,
    generator: np.random.Generator,
) -> Matrix:
    """Step two: new points ``(n, d)`` in the new distribution's local coordinates.

    Args:
        n: How many.
        dimension: d.
        log_ratio: Logarithm of new over old density at points ``(k, d)`` in the new local coordinates.
        refresh_rate: The minimal refresh rate eta: a draw is accepted with max(eta, 1 - old / new).
        generator: Source of randomness.
    """
    accepted: list[Matrix] = []
    missing = n
    while missing > 0:
        drawn = generator.standard_normal((max(4 * missing, 64), dimension))
        chance = np.maximum(refresh_rate, -np.expm1(-np.maximum(log_ratio(drawn), -1.0)))  # below 0 eta is more anyway
        fits = drawn[generator.random(len(drawn)) < chance][:missing]
        accepted.append(fits)
        missing -= len(fits)
    return np.concatenate(accepted)
