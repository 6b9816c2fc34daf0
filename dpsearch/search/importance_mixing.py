"""Importance mixing: keep those points of the last generation that the moved distribution might have drawn (4.5).

Two steps of rejection sampling, ``keep`` here and ``renewed`` in ``rejection.py``, leave a population
distributed exactly as the new search distribution, in which only the newly drawn points need to be evaluated. All is
done in local coordinates, in which a distribution is N(0, I).
"""

from __future__ import annotations

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
    n: int, shift: Vector, stretch: Matrix, log_volume: float, refresh_rate: float, generator: np.random.Generator
) -> Matrix:
    """Step two: new points ``(n, d)`` in the new distribution's local coordinates.

    Args:
        n: How many.
        shift: ``(d,)``, where the new distribution's mean is in the old one's local coordinates.
        stretch: Its factor there: ``(d, d)``, or ``(d,)`` if that is diagonal.
        log_volume: Logarithm of the absolute value of the factor's determinant.
        refresh_rate: The minimal refresh rate eta: a draw is accepted with max(eta, 1 - old / new).
        generator: Source of randomness.
    """
    from dpsearch.search.rejection import renewed  # now, as importing Numba takes longer than many a search

    return np.asarray(renewed(n, shift, np.atleast_2d(stretch), log_volume, refresh_rate, generator))
