"""One search on one of the functions of table 4.1, and the numbers that are kept of it.

Seed k is the same problem for all methods: the same rotation and shift of the function, and the same start.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpsearch.search import SEARCHES, Search
from dpsearch.search.base import Matrix, Vector
from dpsearch.search.functions import FUNCTIONS, Transformed, rotated_and_shifted
from scripts.experiments.jobs import Outcome

SIGMA = 1.0  # the initial search distribution is N(start, I), section 4.7.2
POINTS = 40  # of a curve
SPAN = 2_000  # evaluations that a curve shows, for each dimension
PER_DECADE = 100  # curves are kept as whole numbers: hundredths of a decade

Options = tuple[tuple[str, Any], ...]


@dataclass(frozen=True)
class Problem:
    """A function to be minimised, and the search that does it. Hashable, so that it can be a recipe.

    Attributes:
        function: Name of the function.
        dimension: Dimension d.
        search: Name of the search.
        options: Options of the search, as pairs.
        distance: Distance of the start from the optimum, in a uniformly random direction; None for a start
            ~ N(0, I) around the optimum.
        max_evaluations: Evaluations after which the run has failed.
        tolx: Part of its initial width below which the search distribution has shrunk to a point.
        curve: Whether to keep the best cost over evaluations.
    """

    function: str
    dimension: int
    search: str
    options: Options
    distance: float | None
    max_evaluations: int
    tolx: float
    curve: bool

    @property
    def network(self) -> str:
        """Empty: a search of functions has no policy."""
        return ""

    def fingerprint(self) -> str:
        """Tells problems apart by all that an outcome depends on, the seed aside."""
        parts = {**asdict(self), "sigma": SIGMA, "target": FUNCTIONS[self.function].target}
        if self.curve:
            parts["grid"] = grid(self.dimension).tolist()
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:16]

    def begin(self, seed: int) -> tuple[Transformed, Search]:
        """The function in its place, and the search at its start."""
        function = rotated_and_shifted(FUNCTIONS[self.function], self.dimension, seed)
        start = np.random.default_rng((seed, 1)).standard_normal(self.dimension)
        if self.distance is not None:
            start *= self.distance / np.linalg.norm(start)
        search = SEARCHES[self.search](
            function.shift + start,
            SIGMA,
            seed=seed,
            target=-function.function.target,
            max_evaluations=self.max_evaluations,
            tolx=self.tolx,
            **dict(self.options),
        )
        return function, search


def minimise(problem: Problem, seed: int) -> Outcome:
    """Search until the target is reached, or until the search gives up."""
    function, search = problem.begin(seed)
    told: list[Vector] = []
    while not search.stop():
        points = search.ask()
        costs = function(points)
        search.tell(points, -costs)
        told.append(costs)
    solved = "target" in search.stop()
    outcome: Outcome = {
        "solved": int(solved),
        "evaluations": search.best.evaluation if solved else search.evaluations,
    }
    if problem.curve:
        best = np.minimum.accumulate(np.concatenate(told))
        at = grid(problem.dimension)
        unbounded = function.function.target < 0.0
        outcome["curve"] = np.rint(PER_DECADE * _level(best[at[at <= len(best)] - 1], unbounded)).astype(int).tolist()
    return outcome


def grid(dimension: int) -> NDArray[np.int64]:
    """``(POINTS,)``: the evaluations at which a curve is kept, close together at first."""
    return np.rint(SPAN * dimension * (np.arange(1, POINTS + 1) / POINTS) ** 2).astype(np.int64)


def cost(level: Vector, unbounded: bool) -> Vector:
    """The cost of a level: 10^level, or for an unbounded function, whose cost has both signs, +-(10^|level| - 1)."""
    return np.asarray(np.sign(level) * np.expm1(np.abs(level) * np.log(10.0)) if unbounded else 10.0**level)


def _level(costs: Vector, unbounded: bool) -> Vector:
    """Inverse of ``cost``."""
    if unbounded:
        return np.asarray(np.sign(costs) * np.log1p(np.abs(costs)) / np.log(10.0))
    return np.asarray(np.log10(np.maximum(costs, 1e-99)))


@dataclass(frozen=True)
class Curve:
    """Best cost over evaluations: the median of many runs, and the quartiles.

    Attributes:
        evaluations: ``(n,)`` evaluations.
        median: ``(n,)`` cost.
        low: ``(n,)`` cost of the better quarter.
        high: ``(n,)`` cost of the worse quarter.
        reached: Evaluations at which the median run reaches the target; None if it does not.
    """

    evaluations: Vector
    median: Vector
    low: Vector
    high: Vector
    reached: float | None


def summary(problem: Problem, outcomes: Sequence[Outcome]) -> Curve:
    """The curve of many runs. A run that has ended stays where it is."""
    target = FUNCTIONS[problem.function].target
    unbounded = target < 0.0
    at = grid(problem.dimension)
    goal = PER_DECADE * float(_level(np.array(target), unbounded))
    levels: Matrix = np.full((len(outcomes), len(at)), np.inf)
    for own, outcome in zip(levels, outcomes, strict=True):
        known = outcome["curve"]
        own[: len(known)] = known
        own[len(known) :] = goal if outcome["solved"] else known[-1] if known else np.inf
    quartiles = np.quantile(np.maximum(levels, goal), (0.5, 0.25, 0.75), axis=0, method="inverted_cdf")
    median, low, high = (cost(quartile / PER_DECADE, unbounded) for quartile in quartiles)
    needed = [outcome["evaluations"] if outcome["solved"] else np.inf for outcome in outcomes]
    reached = float(np.quantile(needed, 0.5, method="inverted_cdf"))
    return Curve(at.astype(np.float64), median, low, high, reached if np.isfinite(reached) else None)
