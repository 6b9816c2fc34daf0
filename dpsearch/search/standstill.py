"""Standstill: the signs in the fitness that a search gets no further, though its distribution has not shrunk.

Where the best fitness is not 0, values near the optimum differ by rounding alone long before the distribution has
shrunk to a point, and on equal fitness a search by rank does not move at all. Two rules, after N. Hansen, "The CMA
evolution strategy: a tutorial", appendix B.3, but counted in evaluations, as a generation may be one of them:

    flat          all of the last 10 r + 30 d values are equal, up to ``tolfun`` and to rounding
    stagnation    neither the best value, nor the median or the mean of a block of 10 r values has got better during
                  the last ``stagnation`` r evaluations, nor during the last third of all

where r is the number of points that are ranked together. A median or mean is better if it exceeds the best one before
by a standard error: a slow rise soon adds up to that, and noise does not. A third rule, ``condition``, looks at the
distribution.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROUNDING = 32 * float(np.finfo(np.float64).eps)  # of a fitness that is a sum of many terms, relative
BLOCK = 10  # times r: values that make a median
WINDOW = 30  # times d, beyond a block: values that must be flat
PART = 3  # a long run must have been in vain for one such part


class Standstill:
    """Rules that end a stuck search. They keep a summary of its fitness, which does not grow with the run.

    Args:
        tolfun: Differences of fitness that count as none, beside those of rounding; None: no rule ``flat``.
        stagnation: Evaluations in vain, as a multiple of ``ranked``; None: no rule ``stagnation``.
        max_condition: Condition number that is accepted; None: no rule ``condition``.
        ranked: Points that are ranked together, r.
        dimension: d.
    """

    def __init__(
        self, tolfun: float | None, stagnation: int | None, max_condition: float | None, ranked: int, dimension: int
    ) -> None:
        self.tolfun = tolfun
        self.max_condition = max_condition
        self.block_size = BLOCK * ranked
        self.window = self.block_size + WINDOW * dimension
        self.patience = None if stagnation is None else stagnation * ranked
        self.condition = 1.0
        self._evaluations = 0
        self._low, self._high = math.inf, -math.inf  # of the values that are flat so far, the last ones
        self._flat_from = 0  # evaluations before the first of them
        self._block: list[float] = []
        self._median = self._mean = -math.inf  # the best of a block
        self._better = 0  # evaluations at the last block that was better
        self.active = any(rule is not None for rule in (tolfun, stagnation, max_condition))

    def observe(self, fitness: NDArray[np.float64]) -> bool:
        """Take note of a generation, ``(n,)`` with -inf where it was invalid; whether that completed a block."""
        before = self._evaluations
        self._evaluations += len(fitness)
        low, high = float(fitness.min()), float(fitness.max())
        joined = min(low, self._low), max(high, self._high)
        if self._is_flat(*joined):
            self._low, self._high = joined
        elif self._is_flat(low, high):
            self._low, self._high, self._flat_from = low, high, before
        else:
            self._low, self._high, self._flat_from = math.inf, -math.inf, self._evaluations
        self._block.extend(fitness.tolist())
        if len(self._block) < self.block_size:
            return False
        self._judge(np.sort(self._block))
        self._block = []
        return True

    def _judge(self, values: NDArray[np.float64]) -> None:
        """Compare a block, sorted, with the best ones before."""
        n = len(values)
        median, quartiles = float(values[n // 2]), (float(values[n // 4]), float(values[3 * n // 4]))
        spread = quartiles[1] - quartiles[0] if math.isfinite(quartiles[0]) else 0.0
        finite = values[np.isfinite(values)]
        with np.errstate(over="ignore"):
            mean = float((finite / len(finite)).sum()) if len(finite) else -math.inf
            deviation = float(np.sqrt((((finite - mean) / math.sqrt(len(finite))) ** 2).sum())) if len(finite) else 0.0
        if median > self._median + spread / math.sqrt(n):
            self._median, self._better = median, self._evaluations
        if mean > self._mean + deviation / math.sqrt(n):
            self._mean, self._better = mean, self._evaluations

    def reasons(self, best_evaluation: int) -> dict[str, Any]:
        """Reasons to stop, reason -> value.

        Args:
            best_evaluation: The number of the evaluation that found the best point.
        """
        found: dict[str, Any] = {}
        if self.tolfun is not None and (flat := self._evaluations - self._flat_from) >= self.window:
            found["flat"] = flat
        vain = self._evaluations - max(best_evaluation, self._better)
        if self.patience is not None and vain >= max(self.patience, self._evaluations / PART):
            found["stagnation"] = vain
        if self.max_condition is not None and self.condition > self.max_condition:
            found["condition"] = self.condition
        return found

    def state_dict(self) -> dict[str, Any]:
        """All that the rules depend on: numbers and an array."""
        return {
            "condition": self.condition,
            "evaluations": self._evaluations,
            "low": self._low,
            "high": self._high,
            "flat_from": self._flat_from,
            "block": np.array(self._block, np.float64),
            "median": self._median,
            "mean": self._mean,
            "better": self._better,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on exactly where ``state_dict`` was taken."""
        mine = {name: state[name] for name in self.state_dict()}  # all of it, before anything changes
        self.condition = mine["condition"]
        self._evaluations = mine["evaluations"]
        self._low, self._high, self._flat_from = mine["low"], mine["high"], mine["flat_from"]
        self._block = mine["block"].tolist()
        self._median, self._mean, self._better = mine["median"], mine["mean"], mine["better"]

    def _is_flat(self, low: float, high: float) -> bool:
        if low == high:  # minus infinity too: nothing valid
            return True
        tolerance = max(self.tolfun or 0.0, ROUNDING * max(abs(low), abs(high)))
        return math.isfinite(low) and high - low <= tolerance
