"""The vectors that a compiled core multiplies its matrices with, stacked row by row, and the sizes of a policy.

A layer's matrix has its biases as one more column, so that one product with (inputs, memory, 1) does a whole layer.
All functions here work on all lanes at once.
"""

from __future__ import annotations

from numba import njit

from dpsearch.kernels.lanes import LANES
from dpsearch.kernels.matvec import matvec

OBSERVATION, UNITS, OUTPUTS, BIAS, ECHO, ONE_HOT, NOISE = range(7)
"""Places in a policy's ``sizes``.

Observation size, units of the core, outputs, 1 if there are biases, rows of the previous action among the inputs, 1 if
these are one-hot, and rows of noise that lasts.
"""


@njit(inline="always")
def put(rows, count, stacked, first):
    """Copies the first ``count`` rows into ``stacked``, from row ``first`` on; returns the row below them."""
    for i in range(count):
        for lane in range(LANES):
            stacked[first + i, lane] = rows[i, lane]
    return first + count


@njit(inline="always")
def put_with_one(rows, count, bias, stacked, first):
    """``put``, and a row of ones below if ``bias`` is 1. The row of ones is written in any case."""
    columns = put(rows, count, stacked, first)
    for lane in range(LANES):
        stacked[columns, lane] = 1.0
    return columns + bias


@njit(inline="always")
def put_inputs(sizes, observation, previous, stacked, first):
    """Puts (observation, previous action) into ``stacked``, from row ``first`` on; returns the row below them."""
    columns = put(observation, sizes[OBSERVATION], stacked, first)
    return put(previous, sizes[ECHO], stacked, columns)


@njit(inline="always")
def stack(sizes, observation, previous, memory, n_memory, stacked):
    """Makes (observation, previous action, memory, 1), without the 1 if there are no biases; returns its length."""
    columns = put_inputs(sizes, observation, previous, stacked, 0)
    return put_with_one(memory, n_memory, sizes[BIAS], stacked, columns)


@njit(inline="always")
def stacked_rows(sizes):
    """Rows of working memory that the longest of these vectors takes."""
    return sizes[OBSERVATION] + sizes[ECHO] + sizes[NOISE] + sizes[UNITS] + 1


@njit(inline="always")
def read_out(sizes, weights, first, features, noise, stacked, output, lanes):
    """The linear read-out: ``output = W (features, noise, 1)``, where W starts at ``weights[first]``."""
    columns = put(features, sizes[UNITS], stacked, 0)
    columns = put_with_one(noise, sizes[NOISE], sizes[BIAS], stacked, columns)
    matvec(weights, first, sizes[OUTPUTS], columns, stacked, output, lanes)
