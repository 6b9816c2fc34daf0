"""The shapes of lanes, and functions and counters that threads share."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit, types

from dpsearch.kernels.lanes import FLOATS, INTS, ROWS, address_of, fetch_add, function_at, noise_rows


def test_noise_rows_come_in_fours() -> None:
    assert [noise_rows(draws) for draws in (0, 1, 4, 5, 8)] == [0, 4, 4, 8, 8]


@njit(types.void(INTS, INTS), nogil=True)
def _take(counter, taken):
    for i in range(len(taken)):
        taken[i] = fetch_add(counter)


def test_fetch_add_gives_every_number_once_to_competing_threads() -> None:
    counter = np.array([10], np.int64)
    taken = [np.empty(50_000, np.int64) for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda mine: _take(counter, mine), taken))
    assert counter[0] == 200_010
    assert sorted(np.concatenate(taken)) == list(range(10, 200_010))


_DOUBLE_IT = types.void(FLOATS)
_doubler_at = function_at(_DOUBLE_IT)


@njit(_DOUBLE_IT)
def _double_it(x):
    for i in range(len(x)):
        x[i] *= 2.0


@njit(types.void(types.int64, FLOATS), nogil=True)
def _call(address, x):
    _doubler_at(address)(x)


def test_a_compiled_function_can_be_called_by_its_address() -> None:
    x = np.arange(3.0)
    _call(address_of(_double_it, _DOUBLE_IT), x)
    assert x.tolist() == [0, 2, 4]
    assert address_of(_double_it, _DOUBLE_IT) == address_of(_double_it, _DOUBLE_IT)


def test_lane_arrays_are_float64_rows_with_the_lane_last() -> None:
    assert str(ROWS) == "array(float64, 2d, C)"
    assert str(FLOATS) == "array(float64, 1d, C)"
