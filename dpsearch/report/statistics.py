"""Confidence intervals of numbers that come from a handful of runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from scipy import stats

Statistic = Literal["mean", "median"]
LEVEL = 0.95
RESAMPLES = 9_999

_FUNCTIONS: dict[Statistic, Callable[..., np.floating]] = {"mean": np.mean, "median": np.median}


def bootstrap_interval(values: Sequence[float], statistic: Statistic) -> tuple[float, float] | None:
    """The 95% interval of a mean or median, by the percentile bootstrap; None for fewer than two values.

    Percentiles rather than BCa: that is undefined when values are equal, and erratic for medians. The resampling
    has a fixed seed, so the same values always give the same interval.
    """
    if len(values) < 2:
        return None
    result = stats.bootstrap(
        (np.asarray(values, np.float64),),
        _FUNCTIONS[statistic],
        n_resamples=RESAMPLES,
        confidence_level=LEVEL,
        method="percentile",
        random_state=np.random.default_rng(0),
    )
    return float(result.confidence_interval.low), float(result.confidence_interval.high)


def success_interval(successes: int, runs: int) -> tuple[float, float]:
    """The 95% interval of a success rate, by Wilson's score, which is sensible even for 20 of 20."""
    interval = stats.binomtest(successes, runs).proportion_ci(LEVEL, method="wilson")
    return float(interval.low), float(interval.high)
