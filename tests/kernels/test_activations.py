"""Activations in either precision."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from dpsearch.kernels import activations
from tests.support.accuracy import elementary, error, points


@njit  # type: ignore[untyped-decorator, unused-ignore]
def _activations(x, out):
    for i in range(len(x)):
        out[0, i] = activations.exp(x[i])
        out[1, i] = activations.sigmoid(x[i])
        out[2, i] = activations.tanh(x[i])


def in_precision(x: NDArray[np.floating]) -> list[NDArray[np.floating]]:
    """Exponential, sigmoid and hyperbolic tangent, in the precision of the arguments."""
    out = np.empty((3, len(x)), x.dtype)
    _activations(x, out)
    return list(out)


def test_activations_in_single_precision_are_accurate_to_its_rounding() -> None:
    x = points(-86, 87).astype(np.float32)
    exact = np.exp(x.astype(np.float64))
    exponential, sigmoid_of_x, _ = in_precision(x)
    assert error(exponential, exact) < 3e-7
    assert error(sigmoid_of_x, 1 / (1 + 1 / exact)) < 3e-7
    x = points(-12, 12).astype(np.float32)
    np.testing.assert_allclose(in_precision(x)[2], np.tanh(x.astype(np.float64)), rtol=3e-7, atol=2e-7)


def test_activations_in_single_precision_at_their_ends() -> None:
    at = in_precision(np.array([0.0, -0.0, -1e4, 1e4, math.inf, -math.inf], np.float32))
    assert at[0][:2].tolist() == [1, 1]
    assert at[1].tolist() == pytest.approx([0.5, 0.5, 0, 1, 1, 0], abs=1e-30)
    assert at[2].tolist() == pytest.approx([0, 0, -1, 1, 1, -1], rel=1e-7)


def test_activations_in_double_precision_are_the_elementary_functions() -> None:
    x = points(-30, 30)
    for ours, name in zip(in_precision(x), ("exp", "sigmoid", "tanh"), strict=True):
        np.testing.assert_array_equal(ours, elementary(x)[name])
