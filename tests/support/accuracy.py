"""Points at which functions are tried, their error there, and the elementary functions of arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dpsearch.kernels.elementary import exp, log, sigmoid, sincos, tanh


@njit  # type: ignore[untyped-decorator, unused-ignore]
def _elementary(x, out):
    for i in range(len(x)):
        out[0, i] = exp(x[i])
        out[1, i] = tanh(x[i])
        out[2, i] = sigmoid(x[i])
        out[3, i], out[4, i] = sincos(x[i])
        out[5, i] = log(abs(x[i]))


def elementary(x: Any) -> dict[str, NDArray[np.float64]]:
    x = np.array(x, np.float64)
    out = np.empty((6, len(x)))
    _elementary(x, out)
    return dict(zip(("exp", "tanh", "sigmoid", "sin", "cos", "log"), out, strict=True))


def points(low: float, high: float) -> NDArray[np.float64]:
    random = np.random.default_rng(2)
    return np.concatenate([np.linspace(low, high, 20_001), random.uniform(low, high, 100_000)])


def error(ours: NDArray[np.floating], exact: NDArray[np.floating]) -> float:
    """The largest relative error; the reference has 64 bits of mantissa."""
    exact = np.asarray(exact, np.longdouble)
    return float(np.max(np.abs((ours - exact) / np.where(exact == 0, 1, exact))))
