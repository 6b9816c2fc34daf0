"""Products of matrices and vectors, lane by lane."""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from dpsearch.kernels.lanes import LANES, WIDTH
from dpsearch.kernels.matvec import matvec


@njit  # type: ignore[untyped-decorator, unused-ignore]
def _matvec(weights, offset, rows, columns, x, output, lanes=LANES):
    matvec(weights, offset, rows, columns, x, output, lanes)


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize(("rows", "columns"), [(0, 3), (1, 1), (3, 5), (4, 4), (9, 7), (40, 13)])
def test_matvec_is_the_product_of_matrix_and_vector(rows: int, columns: int, shared: bool) -> None:
    random = np.random.default_rng(rows)
    offset = 5
    weights = random.normal(size=offset + rows * columns + 2 if shared else (offset + rows * columns + 2, LANES))
    x, output = random.normal(size=(columns + 1, LANES)), random.normal(size=(rows + 1, LANES))
    before = output.copy()
    _matvec(weights, offset, rows, columns, x, output)
    matrix = weights[offset : offset + rows * columns].reshape(rows, columns, *weights.shape[1:])
    product = np.einsum("rc,cl->rl" if shared else "rcl,cl->rl", matrix, x[:columns])
    np.testing.assert_allclose(output[:rows], product, rtol=1e-13, atol=1e-13)
    assert (output[rows] == before[rows]).all()  # nothing beyond the rows asked for


def test_matvec_fuses_each_product_with_its_sum_in_the_order_of_the_columns() -> None:
    random = np.random.default_rng(9)
    rows, columns = 5, 6
    weights, x = random.normal(size=rows * columns), random.normal(size=(columns, LANES))
    output = np.zeros((rows, LANES))
    _matvec(weights, 0, rows, columns, x, output)
    for row in range(rows):
        for lane in range(LANES):
            total = 0.0
            for column in range(columns):
                product = Fraction(weights[row * columns + column]) * Fraction(x[column, lane])
                total = float(product + Fraction(total))  # rounded once
            assert output[row, lane] == total


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("lanes", range(WIDTH, LANES, WIDTH))
def test_matvec_of_fewer_lanes_gives_the_same_and_touches_no_others(lanes: int, shared: bool) -> None:
    random = np.random.default_rng(lanes)
    rows, columns = 7, 5
    weights = random.normal(size=rows * columns if shared else (rows * columns, LANES))
    x = random.normal(size=(columns, LANES))
    every, some, packed = np.zeros((rows, LANES)), np.zeros((rows, LANES)), np.zeros(rows * LANES)
    _matvec(weights, 0, rows, columns, x, every)
    _matvec(weights, 0, rows, columns, x, some, lanes)
    np.testing.assert_array_equal(some[:, :lanes], every[:, :lanes])
    assert (some[:, lanes:] == 0.0).all()
    _matvec(weights, 0, rows, columns, x, packed, lanes)  # into one row, without gaps
    np.testing.assert_array_equal(packed[: rows * lanes].reshape(rows, lanes), every[:, :lanes])


@pytest.mark.parametrize("written", ["float32", "float64"])
def test_matvec_in_single_precision_may_write_either(written: str) -> None:
    random = np.random.default_rng(4)
    weights, x = random.normal(size=7 * 5).astype(np.float32), random.normal(size=(5, LANES)).astype(np.float32)
    output: NDArray[Any] = np.empty((7, LANES), written)
    _matvec(weights, 0, 7, 5, x, output)
    np.testing.assert_allclose(output, weights.reshape(7, 5).astype(np.float64) @ x, rtol=1e-6, atol=1e-6)
