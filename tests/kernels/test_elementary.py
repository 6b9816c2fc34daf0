"""Elementary functions that vectorise, in double precision."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numba import njit

from dpsearch.kernels.elementary import arctan2
from tests.support.accuracy import elementary, error, points


@njit  # type: ignore[untyped-decorator, unused-ignore]
def _angles(y, x, out):
    for i in range(len(x)):
        out[i] = arctan2(y[i], x[i])


def test_exp_and_sigmoid_are_accurate_to_1e_14() -> None:
    x = points(-707, 708)
    exact = np.exp(x.astype(np.longdouble))
    assert error(elementary(x)["exp"], exact) < 1e-14
    assert error(elementary(x)["sigmoid"], 1 / (1 + 1 / exact)) < 1e-14


def test_tanh_is_accurate_to_1e_14_also_near_zero() -> None:
    small = np.concatenate([sign * 10.0 ** np.linspace(-300, 0, 3001) for sign in (-1, 1)])
    x = np.concatenate([points(-25, 25), small])
    assert error(elementary(x)["tanh"], np.tanh(x.astype(np.longdouble))) < 1e-14


def test_sine_and_cosine_are_accurate_to_1e_14_up_to_a_hundred_thousand_radians() -> None:
    x = np.concatenate([points(-4, 4), points(-1e5, 1e5), np.arange(-200, 200) * (np.pi / 2)])
    ours, exact = elementary(x), x.astype(np.longdouble)
    assert np.max(np.abs(ours["sin"] - np.sin(exact))) < 1e-14
    assert np.max(np.abs(ours["cos"] - np.cos(exact))) < 1e-14


def test_log_is_accurate_to_1e_14_over_all_normal_numbers() -> None:
    x = np.concatenate([points(1e-3, 3), 10.0 ** points(-307, 308), 1 + 10.0 ** points(-15, -1)])
    assert error(elementary(x)["log"], np.log(x.astype(np.longdouble))) < 1e-14


def test_angles_are_accurate_to_1e_14_in_all_directions() -> None:
    random = np.random.default_rng(3)
    y, x = random.standard_normal((2, 100_000)) * 10.0 ** random.uniform(-20, 20, (2, 100_000))
    y[:1000], x[:1000] = np.sin(points(-4, 4)[:1000]), np.cos(points(-4, 4)[:1000])
    ours = np.empty(len(x))
    _angles(y, x, ours)
    assert error(ours, np.arctan2(y.astype(np.longdouble), x.astype(np.longdouble))) < 1e-14


def test_angles_of_axes_and_the_origin() -> None:
    y, x = np.array([[0.0, 0.0, 1.0, -1.0, 0.0, 3.0, -3.0], [0.0, 2.0, 0.0, 0.0, -2.0, 3.0, -3.0]])
    ours = np.empty(len(x))
    _angles(y, x, ours)
    np.testing.assert_allclose(ours, np.arctan2(y, x), rtol=1e-15)


def test_elementary_functions_at_their_ends() -> None:
    at = elementary([0.0, -0.0, -1e4, 1e4, math.inf, -math.inf])
    assert at["exp"].tolist() == pytest.approx([1, 1, *[math.exp(x) for x in (-708, 709, 709, -708)]], rel=1e-14)
    assert at["tanh"].tolist() == [0, 0, -1, 1, 1, -1]
    assert at["sigmoid"][:2].tolist() == [0.5, 0.5]
    assert at["sigmoid"][2:].tolist() == pytest.approx([0, 1, 1, 0], abs=1e-300)
    assert at["sin"][:2].tolist() == [0, 0]
    assert at["cos"][:2].tolist() == [1, 1]
    assert elementary([1.0])["log"].tolist() == [0]
