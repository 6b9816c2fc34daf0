"""Injection: points told in place of those asked, in local coordinates, where x = mean + factor y.

Updates are made for draws y ~ N(0, I), while points told may lie anywhere: far out, a squared length outweighs all
others, and one point decides on the whole generation. So their y is shortened to a length that a draw might have: they
still say in which direction to go (N. Hansen, "Injecting external solutions into CMA-ES", Inria report 7748, 2011).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST = 1e-150  # whose square is still a number


def which(points: Array, asked: Array) -> NDArray[np.intp]:
    """Number of the asked point that each point ``(d,)`` is, in any order; -1 if it is none of them."""
    numbers = {point.tobytes(): k for k, point in enumerate(asked)}
    return np.array([numbers.get(point.tobytes(), -1) for point in points], np.intp)


def reach(dimension: int) -> float:
    """Length of the longest y of a point that was not drawn: sqrt d + 2 d / (d + 2)."""
    return math.sqrt(dimension) + 2.0 * dimension / (dimension + 2.0)


def offsets(points: Array, mean: Array) -> tuple[Array, Array]:
    """From mean to points ``(n, d)``, in units ``(n, 1)``: powers of two, so this is exact and does not overflow."""
    largest = np.maximum(np.abs(points).max(axis=1, initial=0.0), np.abs(mean).max())
    units = np.ldexp(1.0, np.frexp(largest)[1] - 1)[:, None]
    return points / units - mean / units, units


def scales(lengths: Array, units: Array, dimension: int) -> Array:
    """Factors ``(n, 1)`` of offsets whose y have these lengths ``(n, 1)``: their units, or less beyond the reach."""
    return np.asarray(np.minimum(units, reach(dimension) / np.maximum(lengths, LEAST)))


def local_coordinates(points: Array, mean: Array, factor: Array) -> Array:
    """The y ``(n, d)`` of points ``(n, d)``, no longer than the reach.

    Args:
        points: ``(n, d)``.
        mean: ``(d,)``.
        factor: ``(d, d)``, or ``(d,)`` if it is diagonal.
    """
    away, units = offsets(points, mean)
    local = away / factor if factor.ndim == 1 else _solved(factor, away)
    size = np.maximum(np.abs(local).max(axis=1, initial=0.0), LEAST)[:, None]
    lengths = size * np.linalg.norm(local / size, axis=1, keepdims=True)
    return np.asarray(local * scales(lengths, units, len(mean)))


def _solved(factor: Array, away: Array) -> Array:
    """The y with ``factor y = x`` for the rows x of a matrix; the shortest ones if some directions have no width."""
    try:
        return np.asarray(np.linalg.solve(factor, away.T).T, np.float64)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(factor, away.T, rcond=None)[0].T, np.float64)
