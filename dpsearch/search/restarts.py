"""Restarts: begin again elsewhere when a search is stuck, for multimodal fitness and early convergence.

The one thing to understand: a run must end for certain, or nothing begins again. Where the best fitness is not 0 the
search distribution never shrinks to a point, as fitness is flat by rounding long before; so each run has all of the
rules of ``Search`` (``RULES``) unless told otherwise.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dpsearch.search.arguments import accepted_by, number, refuse_unknown, shown, whole
from dpsearch.search.base import Matrix, Search, Vector

LIMITS = frozenset({"target", "max_evaluations"})  # reasons that stop all of the search
RULES = {"tolfun": 0.0, "stagnation": 120, "max_condition": 1e14}
"""When a run is stuck, unless its options say otherwise; those of None switch a rule off."""
LARGEST_GROWTH = 512  # of a population, over all runs
LEAST_GENERATIONS = 10  # that a grown population must be able to have within the budget


class Restarts(Search):
    """Runs of one kind of search, one after another; each begins when the one before has a reason to stop.

    Args:
        search_type: Class of the runs.
        x0: ``(d,)``, where the first run begins.
        sigma0: Initial standard deviation of each run: one number, or ``(d,)`` of them.
        spread: Each later run begins at x0 plus a Gaussian of this many times ``sigma0``.
        growth: Each later run has a population this many times larger, up to 512 times the first, and to a tenth of
            the evaluations that are left.
        population: Points of a generation of the first run; the search's own choice if None.
        seed: Seed of everything random; drawn from the system if None.
        target: Stop when this fitness is reached.
        max_evaluations: Stop after exactly so many fitness values, of all runs together: the last generation may be
            cut short.
        **options: Options of each run; ``tolfun``, ``stagnation`` and ``max_condition`` are as in ``RULES`` if not
            given.

    Attributes:
        run: The search under way.
        runs: Number of runs begun.

    Raises:
        TypeError: If an argument is unknown to the search and to its runs.
        ValueError: If an argument is out of range.
    """

    name = "restarts"
    _saved = (*Search._saved, "runs")

    def __init__(
        self,
        search_type: type[Search],
        x0: ArrayLike,
        sigma0: ArrayLike,
        *,
        spread: float = 1.0,
        growth: float = 1.0,
        population: int | None = None,
        seed: int | None = None,
        target: float | None = None,
        max_evaluations: int | None = None,
        **options: Any,
    ) -> None:
        if not isinstance(search_type, type) or not issubclass(search_type, Search) or search_type is Restarts:
            raise ValueError(f"search_type must be a class of searches, such as XNES, got {shown(search_type)}")
        accepted = dict.fromkeys([*accepted_by(Restarts)[1:], *accepted_by(search_type)])
        refuse_unknown(f"Restarts of {search_type.__name__}", options, accepted)
        super().__init__(x0, sigma0, population=2, seed=seed, target=target, max_evaluations=max_evaluations)
        self.spread = number("spread", spread, "at least 0 and finite", 0.0, math.inf)
        self.growth = number("growth", growth, "at least 1 and finite", 1.0, math.inf)
        self._type = search_type
        self._options = {**RULES, **options}
        if population is not None:
            self._options["population"] = whole("population", population, search_type.least_population)
        self.runs = 0
        self.run = self._begin(0)
        self.population = self.run.population
        if self.growth > 1.0:  # a search that takes no population says so now, not after the first run
            search_type(self.x0, self.sigma0, **{**self._options, "population": self.population})

    @classmethod
    def _check_names(cls, options: dict[str, Any]) -> None:
        """Leave it to the constructor, which knows the runs' arguments too."""

    @property
    def mean(self) -> Vector:
        """``(d,)``: the centre of the search distribution of the run under way."""
        return self.run.mean

    @property
    def stds(self) -> Vector:
        """``(d,)``: the standard deviations of the run under way, along the axes."""
        return self.run.stds

    def stop(self) -> dict[str, Any]:
        """Reasons to stop, reason -> value: ``target`` or ``max_evaluations``."""
        return {reason: value for reason, value in super().stop().items() if reason in LIMITS}

    def state_dict(self) -> dict[str, Any]:
        """All that the rest of the search depends on: numbers and arrays."""
        return {**super().state_dict(), "run": self.run.state_dict(), "run_population": self.run.population}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on exactly where ``state_dict`` was taken; see ``Search``."""
        run, population = state["run"], state["run_population"]
        super().load_state_dict(state)
        self.runs -= 1
        self.run = self._begin(population)
        self.run.load_state_dict(run)

    def _begin(self, population: int) -> Search:
        """The run of number ``runs``, which is then counted; of this population if populations grow."""
        generator = np.random.default_rng((self.seed, self.runs))
        seed = int(generator.integers(2**64, dtype=np.uint64))
        x0, options = self.x0, self._options
        if self.runs > 0:
            x0 = x0 + self.spread * self.sigma0 * generator.standard_normal(self.dimension)
            if self.growth > 1.0:
                options = {**options, "population": population}
        self.runs += 1
        return self._type(x0, self.sigma0, seed=seed, **options)

    def _grown(self, evaluations: int) -> int:
        """The population of run number ``runs``, which begins after so many evaluations."""
        bounded = self.runs * math.log(self.growth) < math.log(LARGEST_GROWTH)
        grown = round(self.population * (self.growth**self.runs if bounded else LARGEST_GROWTH))
        if self.max_evaluations is not None:
            grown = min(grown, (self.max_evaluations - evaluations) // LEAST_GENERATIONS)
        return max(grown, self.population)

    def _propose(self) -> Matrix:
        points = self.run.ask()
        left = len(points) if self.max_evaluations is None else self.max_evaluations - self.evaluations
        return points[:left] if left > 0 else points

    def _learn(self, points: Matrix, fitness: Vector) -> None:
        if len(points) < len(self.run.ask()):  # the budget is used up: there is no next generation to learn for
            return
        self.run._take(points, fitness)
        if self.run.stop():
            self.run = self._begin(self._grown(self.evaluations + len(points)))
