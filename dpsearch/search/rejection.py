"""Rejection sampling from one Gaussian in place of another, a number at a time (section 4.5).

Compiled, it takes less time than NumPy for the random numbers alone, which are the same ones: Numba draws from NumPy's
own generators.
"""

from __future__ import annotations

import math

import numpy as np

from dpsearch.kernels.lanes import FASTMATH
from dpsearch.kernels.on_demand import on_demand


@on_demand(fastmath=FASTMATH)
def renewed(n, shift, stretch, log_volume, refresh_rate, generator):
    """Points ``(n, d)``: draws y from N(0, I), accepted with max(eta, 1 - old / new density).

    Args:
        n: How many.
        shift: ``(d,)``: a point that is y now was shift + stretch y before.
        stretch: ``(d, d)``, or ``(1, d)`` if it is diagonal.
        log_volume: Logarithm of the absolute value of its determinant.
        refresh_rate: Eta.
        generator: Source of randomness.
    """
    d, missing = len(shift), n
    accepted, columns = np.empty((n, d)), stretch.T.copy()
    while missing > 0:
        drawn = np.empty((max(4 * missing, 64), d))
        for k in range(len(drawn)):
            for i in range(d):
                drawn[k, i] = generator.standard_normal()
        old = drawn * stretch[0] if len(stretch) == 1 else drawn @ columns  # local coordinates there, less the shift
        for k in range(len(drawn)):
            log_ratio = -log_volume  # of new over old density
            for i in range(d):
                log_ratio += 0.5 * ((old[k, i] + shift[i]) ** 2 - drawn[k, i] ** 2)
            if generator.random() < max(refresh_rate, -math.expm1(-max(log_ratio, -1.0))):  # below 0 eta is more anyway
                accepted[n - missing] = drawn[k]
                missing -= 1
                if missing == 0:
                    break
    return accepted
