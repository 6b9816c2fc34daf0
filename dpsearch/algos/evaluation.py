"""Outcome of evaluation episodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Evaluation:
    """Returns and lengths of E evaluation episodes.

    Attributes:
        returns: ``(E,)`` undiscounted.
        lengths: ``(E,)`` steps.
    """

    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]

    @property
    def mean_return(self) -> float:
        """Mean undiscounted return."""
        with np.errstate(invalid="ignore"):
            return float(self.returns.mean())

    @property
    def standard_error(self) -> float:
        """Standard error of the mean return; NaN for a single episode, or if a return is not finite."""
        if len(self.returns) < 2:
            return float("nan")
        with np.errstate(invalid="ignore"):
            return float(self.returns.std(ddof=1) / np.sqrt(len(self.returns)))

    @property
    def mean_length(self) -> float:
        """Mean number of steps."""
        return float(self.lengths.mean())
