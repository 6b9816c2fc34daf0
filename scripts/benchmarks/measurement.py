"""One number that was measured several times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """A median and its spread.

    Attributes:
        benchmark: Name of the benchmark.
        what: Name of the measured speed or size.
        unit: Unit of the numbers.
        median: Median of the repetitions.
        low: First quartile of the repetitions.
        high: Third quartile of the repetitions.
        repeats: Number of repetitions.
        at_least: The promised limit, if more is better.
        at_most: The promised limit, if less is better.
    """

    benchmark: str
    what: str
    unit: str
    median: float
    low: float
    high: float
    repeats: int
    at_least: float | None = None
    at_most: float | None = None

    @classmethod
    def of(
        cls,
        values: Sequence[float],
        *,
        benchmark: str,
        what: str,
        unit: str,
        at_least: float | None = None,
        at_most: float | None = None,
    ) -> Self:
        """Median and quartiles of some values."""
        low, median, high = np.quantile(values, [0.25, 0.5, 0.75]).tolist()
        return cls(
            benchmark=benchmark,
            what=what,
            unit=unit,
            median=median,
            low=low,
            high=high,
            repeats=len(values),
            at_least=at_least,
            at_most=at_most,
        )

    @property
    def met(self) -> bool | None:
        """Whether the promise is kept; None if there is none."""
        if self.at_least is None and self.at_most is None:
            return None
        above = self.at_least is None or self.median >= self.at_least
        return above and (self.at_most is None or self.median <= self.at_most)
