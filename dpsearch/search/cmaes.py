"""CMA-ES: the ``cma`` package behind this package's interface, as the peer to measure against and as a choice.

N. Hansen, Y. Akimoto and P. Baudis, "CMA-ES/pycma"; with active covariance updates, which are its default.
"""

from __future__ import annotations

import warnings
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dpsearch.search.arguments import shown
from dpsearch.search.base import Matrix, Search, Vector, one_blas_thread
from dpsearch.search.injection import offsets, scales, which

OURS = frozenset({"popsize", "seed", "randn", "CMA_stds"})
LARGEST_COST = 1e150  # whose square is still a number
QUIET = {"verbose": -9, "verb_log": 0, "signals_filename": "", "seed": np.nan}


class CMAES(Search):
    """CMA-ES; ask, tell and all else as in ``Search``.

    The package's own state cannot be saved without executing code when it is loaded. So ``state_dict`` lists all
    fitness told, and ``load_state_dict`` tells it once more: exact, and about as fast as the search itself.

    Args:
        x0: ``(d,)``, the initial mean.
        sigma0: Initial standard deviation: one number, or ``(d,)`` of them.
        cma_options: Other options, as ``cma.CMAOptions`` has them.
        **options: See ``Search``.

    Attributes:
        es: The ``cma.CMAEvolutionStrategy`` itself. It minimises.

    Raises:
        ValueError: If an argument is out of range or unknown to the package.
    """

    name = "cmaes"
    _saved = (*Search._saved, "_told", "_replaced")

    def __init__(
        self, x0: ArrayLike, sigma0: ArrayLike, *, cma_options: dict[str, Any] | None = None, **options: Any
    ) -> None:
        super().__init__(x0, sigma0, **options)
        if cma_options is not None and not isinstance(cma_options, dict):
            raise ValueError(f"cma_options must be a dictionary or None, got {shown(cma_options)}")
        taken = OURS & (cma_options or {}).keys()
        if taken:
            raise ValueError(f"cma_options must leave {', '.join(sorted(taken))} to the arguments of CMAES")
        self._fitness: list[Vector] = []  # of all generations: told once more when a state is loaded
        self._replaced: dict[int, Matrix] = {}  # generation -> points told in place of those asked
        step = float(self.sigma0.max())
        settings = {"popsize": self.population, "CMA_stds": np.broadcast_to(self.sigma0 / step, self.x0.shape).copy()}
        self._settings = (self.x0, step, {**QUIET, **settings, "randn": self._randn, **(cma_options or {})})
        try:
            self._begin()
        except ValueError as error:
            raise ValueError(f"cma_options must be options of cma: {str(error).splitlines()[0]}") from error

    @property
    def mean(self) -> Vector:
        """``(d,)``: the centre of the search distribution."""
        return np.array(self.es.mean)

    @property
    def stds(self) -> Vector:
        """``(d,)``: the standard deviations of the search distribution along the axes."""
        return np.array(self.es.stds)

    def stop(self) -> dict[str, Any]:
        """Reasons to stop, reason -> value: this package's reasons and those of ``cma``."""
        return {**super().stop(), **self.es.stop()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on exactly where ``state_dict`` was taken; see ``Search``."""
        super().load_state_dict(state)
        told = self._told.reshape(self.generations, self.population)
        self.generations = 0
        self._begin()
        with one_blas_thread():
            for fitness in told:
                asked = self._propose()
                self._tell(self._replaced.get(self.generations, asked), asked, fitness)
                self.generations += 1

    @property
    def _told(self) -> Vector:
        """All fitness told, one generation after another, as it is saved."""
        return np.concatenate([np.zeros(0), *self._fitness])

    @_told.setter
    def _told(self, fitness: Vector) -> None:
        self._fitness = [fitness]

    def _begin(self) -> None:
        self._random = self._generator()
        self.es = _cma().CMAEvolutionStrategy(*self._settings)

    def _propose(self) -> Matrix:
        self._random = self._generator()
        return np.array(self.es.ask())

    def _learn(self, points: Matrix, fitness: Vector) -> None:
        asked = self.ask()
        if not np.array_equal(points, asked):
            self._replaced[self.generations] = points
        self._fitness.append(fitness)
        self._tell(points, asked, fitness)

    def _tell(self, points: Matrix, asked: Matrix, fitness: Vector) -> None:
        costs = -np.clip(fitness, -LARGEST_COST, LARGEST_COST)
        valid = np.isfinite(fitness)
        worst = costs[valid].max() if valid.any() else 0.0
        costs[~valid] = max(worst + 1.0, np.nextafter(worst, np.inf))  # infinite costs upset its bookkeeping
        with warnings.catch_warnings(), np.errstate(over="ignore"):
            warnings.simplefilter("ignore")  # it expects the points that it has asked
            self.es.tell(list(self._shortened(points, asked)), costs.tolist())

    def _shortened(self, points: Matrix, asked: Matrix) -> Matrix:
        """Points as they are if they were asked or are near, else moved towards the mean; see ``injection``."""
        others = which(points, asked) < 0
        if not others.any():
            return points
        mean = self.mean
        away, units = offsets(points[others], mean)
        scale = scales(np.array([[self.es.mahalanobis_norm(y)] for y in away]), units, self.dimension)
        nearer = points.copy()
        nearer[others] = np.where(scale < units, mean + away * scale, points[others])
        return nearer

    def _randn(self, *shape: int) -> Matrix:
        return self._random.standard_normal(shape)


@cache
def _cma() -> ModuleType:
    """The package, imported when it is needed: it imports Matplotlib, and warns of parts that are not used here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import cma
    return cma  # type: ignore[no-any-return]
