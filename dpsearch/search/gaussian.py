"""Searches whose distribution is a Gaussian, in local coordinates: x = mean + factor y with y ~ N(0, I).

Written in y, an update is well conditioned however small or stretched the distribution has become. It is a pair
(shift, stretch): the mean moves to where y = shift is, and the factor becomes factor @ stretch.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dpsearch.search import importance_mixing
from dpsearch.search.arguments import flag, fraction
from dpsearch.search.base import Matrix, Search, Vector
from dpsearch.search.injection import local_coordinates, which

LEAST_STD, LARGEST_STD = 1e-150, 1e150  # whose squares are still numbers


class GaussianSearch(Search):
    """A search that samples from N(mean, factor factor^T).

    Args:
        x0: ``(d,)``, the initial mean.
        sigma0: Initial standard deviation: one number, or ``(d,)`` of them.
        importance_mixing: Keep those points of the last generation that suit the moved distribution, so that fewer
            have to be evaluated: ``ask`` then gives only the new ones (section 4.5).
        refresh_rate: The least part of a generation that is new, eta in (0, 1]. Only with importance mixing.
        **options: See ``Search``.

    Attributes:
        diagonal: Whether the covariance stays diagonal.

    Raises:
        ValueError: If an argument is out of range.
    """

    diagonal: bool = False
    _saved = (
        *Search._saved,
        "_mean",
        "_factor",
        "_kept_local",
        "_kept_fitness",
        "_shift",
        "_stretch",
    )

    def __init__(
        self,
        x0: ArrayLike,
        sigma0: ArrayLike,
        *,
        importance_mixing: bool = False,
        refresh_rate: float = 0.01,
        **options: Any,
    ) -> None:
        super().__init__(x0, sigma0, **options)
        self.importance_mixing = flag("importance_mixing", importance_mixing)
        self.refresh_rate = fraction("refresh_rate", refresh_rate)
        stds = np.broadcast_to(self.sigma0, self.x0.shape).copy()
        self._mean = self.x0.copy()
        self._factor = stds if self.diagonal else np.diag(stds)
        # the last generation in the local coordinates it was drawn in, and the step since then
        self._kept_local = np.zeros((0, self.dimension))
        self._kept_fitness = np.zeros(0)
        self._shift = np.zeros(self.dimension)
        self._stretch = np.ones(self.dimension) if self.diagonal else np.eye(self.dimension)
        self._local = np.zeros((0, self.dimension))  # of the points asked
        self._staying = np.zeros((0, self.dimension))  # of those that need not be evaluated again
        self._staying_fitness = np.zeros(0)

    @property
    def mean(self) -> Vector:
        """``(d,)``: the centre of the search distribution."""
        return self._mean.copy()

    @property
    def factor(self) -> Matrix:
        """``(d, d)``: a root of the covariance matrix, or ``(d,)`` standard deviations if that is diagonal."""
        return self._factor.copy()

    @property
    def stds(self) -> Vector:
        """``(d,)``: the standard deviations of the search distribution along the axes."""
        return self._factor.copy() if self.diagonal else np.sqrt((self._factor**2).sum(axis=1))

    @property
    def condition(self) -> float:
        """Condition number of the factor, with axes in units of ``sigma0``."""
        if self.diagonal:
            return super().condition
        return float(np.linalg.cond(self._factor / np.broadcast_to(self.sigma0, self.x0.shape)[:, None]))

    @abstractmethod
    def _step(self, local: Matrix, fitness: Vector) -> tuple[Vector, Matrix]:
        """From points ``(n, d)`` in local coordinates to the update: shift ``(d,)``, stretch ``(d, d)`` or ``(d,)``."""

    def _propose(self) -> Matrix:
        generator = self._generator()
        self._staying, self._staying_fitness = np.zeros((0, self.dimension)), np.zeros(0)
        before, stretch = self._kept_local, self._stretch
        mixing = self.importance_mixing and len(before) > 0
        if mixing:  # a point's density is that of its y, divided by the volume of the factor
            log_volume = np.log(np.abs(stretch)).sum() if self.diagonal else np.linalg.slogdet(stretch)[1]
        if not mixing or not np.isfinite(log_volume):
            self._local = generator.standard_normal((self.population, self.dimension))
        else:
            inverse = 1.0 / stretch if self.diagonal else np.asarray(np.linalg.inv(stretch), np.float64)
            now = _out_of(inverse, before - self._shift)  # for so many points, half the time of solve()
            log_ratio = 0.5 * (np.vecdot(before, before) - np.vecdot(now, now)) - log_volume
            staying = importance_mixing.keep(log_ratio, self.refresh_rate, generator)
            self._staying, self._staying_fitness = now[staying], self._kept_fitness[staying]
            self._local = importance_mixing.renew(
                self.population - len(self._staying),
                self._shift,
                stretch,
                log_volume,
                self.refresh_rate,
                generator,
            )
        return self._mean + _out_of(self._factor, self._local)

    def _learn(self, points: Matrix, fitness: Vector) -> None:
        local = self._locate(points)
        if len(self._staying):
            local = np.concatenate([local, self._staying])
            fitness = np.concatenate([fitness, self._staying_fitness])
        shift, stretch = self._step(local, fitness)
        self._mean = self._mean + _out_of(self._factor, shift)
        self._factor = self._factor * stretch if self.diagonal else self._factor @ stretch
        stds = self.stds
        if not (stds.min() > LEAST_STD and stds.max() < LARGEST_STD):
            allowed = np.clip(stds, LEAST_STD, LARGEST_STD) / stds
            self._factor = self._factor * (allowed if self.diagonal else allowed[:, None])
        if self.importance_mixing:
            self._kept_local, self._kept_fitness = local, fitness
            self._shift, self._stretch = shift, stretch

    def _locate(self, points: Matrix) -> Matrix:
        """Local coordinates ``(n, d)`` of the points told: as drawn if they were asked, else see ``injection``."""
        asked = self._asked
        assert asked is not None
        if np.array_equal(points, asked):
            return self._local
        numbers = which(points, asked)
        local, others = self._local[numbers], numbers < 0
        local[others] = local_coordinates(points[others], self._mean, self._factor)
        return local


def _out_of(factor: Matrix, local: Matrix) -> Matrix:
    """``factor y`` for one y or for the rows of a matrix."""
    return local * factor if factor.ndim == 1 else local @ factor.T
