"""Begin again elsewhere when a search is stuck: for multimodal fitness, and for algorithms that may converge early."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dpsearch.search.base import Matrix, Search, Vector

LIMITS = frozenset({"target", "max_evaluations"})  # reasons that stop all of the search


class Restarts(Search):
    """Runs of one kind of search, one after another; each begins when the one before has a reason to stop.

    Args:
        search_type: Whose runs.
        x0: ``(d,)``, where the first one begins.
        sigma0: Initial standard deviation of each: one number, or ``(d,)`` of them.
        spread: Each later run begins at x0 plus a Gaussian of this many times ``sigma0``.
        growth: Each later run has a population this many times larger.
        population: Points of a generation of the first run; its own choice if None.
        seed: Of everything random; drawn from the system if None.
        target: Stop when this fitness is reached.
        max_evaluations: Stop after so many fitness values, of all runs together.
        **options: Of each run.

    Attributes:
        run: The search under way.
        runs: How many have begun.

    Raises:
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
        if not (0.0 <= spread < np.inf and 1.0 <= growth < np.inf):
            raise ValueError(f"spread must be at least 0 and growth at least 1, got {spread} and {growth}")
        super().__init__(x0, sigma0, population=2, seed=seed, target=target, max_evaluations=max_evaluations)
        self._type = search_type
        self._options = options if population is None else {**options, "population": population}
        self.spread = spread
        self.growth = growth
        self.runs = 0
        self.run = self._next()
        self.population = self.run.population
        if growth > 1.0:  # a search that takes no population says so now, not after the first run
            search_type(self.x0, self.sigma0, **{**options, "population": self.population})

    @property
    def mean(self) -> Vector:
        """``(d,)``: the centre of the search distribution of the run under way."""
        return self.run.mean

    @property
    def stds(self) -> Vector:
        """``(d,)``: its standard deviations along the axes."""
        return self.run.stds

    def stop(self) -> dict[str, Any]:
        """Why to stop, reason -> value: ``target`` or ``max_evaluations``."""
        return {reason: value for reason, value in super().stop().items() if reason in LIMITS}

    def state_dict(self) -> dict[str, Any]:
        """All that the rest of the search depends on: numbers and arrays."""
        return {**super().state_dict(), "run": self.run.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on exactly where ``state_dict`` was taken; see ``Search``."""
        super().load_state_dict(state)
        self.runs -= 1
        self.run = self._next()
        self.run.load_state_dict(state["run"])

    def _next(self) -> Search:
        """The run of number ``runs``, which is then counted."""
        generator = np.random.default_rng((self.seed, self.runs))
        seed = int(generator.integers(2**64, dtype=np.uint64))
        x0, options = self.x0, self._options
        if self.runs > 0:
            x0 = x0 + self.spread * self.sigma0 * generator.standard_normal(self.dimension)
            if self.growth > 1.0:
                options = {**options, "population": round(self.population * self.growth**self.runs)}
        self.runs += 1
        return self._type(x0, self.sigma0, seed=seed, **options)

    def _propose(self) -> Matrix:
        return self.run.ask()

    def _learn(self, points: Matrix, fitness: Vector) -> None:
        self.run._take(points, fitness)
        if self.run.stop():
            self.run = self._next()
