"""The least squares fit of a quadratic polynomial: its normal equations, faster than by a matrix product.

The regressors are the products y_a y_b, a <= b, of a point's coordinates and of y_0 = 1, so an entry of their Gram
matrix is a sum of y_a y_b y_c y_d over the points, whatever the order of the factors. For a <= b <= c <= d it is
computed once, as that of (y_a y_b) and (y_c y_d), and serves three pairs of regressors.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from dpsearch.kernels.lanes import LANES
from dpsearch.kernels.matvec import matvec
from dpsearch.kernels.on_demand import on_demand

_SCALE = math.sqrt(0.5)


@njit(inline="always")
def _at(a, b):
    """The number of the product y_a y_b, a <= b: all those of the first coordinates come first."""
    return b * (b + 1) // 2 + a


@on_demand()
def normal_equations(points, targets, gram, right):
    """Write ``gram`` and ``right`` of the equations ``gram @ coefficients = right`` of the best fit of the targets.

    Number ``b (b + 1) / 2 + a`` of the p = (d + 1) (d + 2) / 2 regressors is y_a y_b, a <= b, but y_b^2 counts as
    (y_b^2 - 1) / sqrt 2: then they are orthonormal under N(0, I).

    Args:
        points: ``(n, d)``, y_1 to y_d of each.
        targets: ``(n,)``.
        gram: ``(p, p)``, of which only the upper triangle is written.
        right: ``(p,)``.
    """
    n, size, p = points.shape[0], points.shape[1] + 1, right.shape[0]
    y = np.ones((size, n))
    for i in range(1, size):
        for k in range(n):
            y[i, k] = points[k, i - 1]
    products = np.empty((p, n))
    first, second = np.empty(p, np.int64), np.empty(p, np.int64)  # (c, d) of a column, ordered by c
    q = 0
    for b in range(size):
        for a in range(b + 1):
            for k in range(n):
                products[_at(a, b), k] = y[a, k] * y[b, k]
        for d in range(b, size):
            first[q], second[q] = b, d
            q += 1
    weights = products.reshape(-1)
    columns, sums = np.zeros((n, LANES)), np.empty((p, LANES))
    for start in range(0, p + 1, LANES):  # behind the last column come the targets
        width = min(LANES, p + 1 - start)
        for lane in range(width):
            q = start + lane
            column = targets if q == p else products[_at(first[q], second[q])]
            for k in range(n):
                columns[k, lane] = column[k]
        highest = first[min(start + width, p) - 1]
        matvec(weights, 0, _at(highest, highest) + 1, n, columns, sums, LANES)
        for q in range(start, min(start + width, p)):
            c, d = first[q], second[q]
            for b in range(c + 1):
                for a in range(b + 1):
                    total = sums[_at(a, b), q - start]
                    gram[_at(a, b), _at(c, d)] = total
                    gram[_at(b, c), _at(a, d)] = total
                    gram[_at(a, c), _at(b, d)] = total
    right[:] = sums[:, p % LANES]
    for b in range(1, size):  # from y_b^2 to (y_b^2 - 1) / sqrt 2
        s = _at(b, b)
        for q in range(1, p):
            if q < s:
                gram[q, s] = _SCALE * (gram[q, s] - gram[0, q])
            elif q > s:
                gram[s, q] = _SCALE * (gram[s, q] - gram[0, q])
        gram[s, s] = 0.5 * (gram[s, s] - 2.0 * gram[0, s] + gram[0, 0])
        gram[0, s] = _SCALE * (gram[0, s] - gram[0, 0])
        right[s] = _SCALE * (right[s] - right[0])
