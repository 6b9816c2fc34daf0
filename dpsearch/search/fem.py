"""FEM, fitness expectation maximization: chapter 5 of the thesis, algorithm 5.1.

The search distribution is fitted, by maximum likelihood, to its own samples weighted by the utility of their fitness.
Online, every sample moves it at once (section 5.3):

    u_k = u(f(z_k) | f(z_k-1), .., f(z_k-N))
    x      <- (1 - alpha u_k) x      + alpha u_k z_k
    Sigma  <- (1 - alpha u_k) Sigma  + alpha u_k (z_k - x) (z_k - x)^T

The one thing to understand: with one alpha for both lines, Sigma is an average of about 1 / alpha samples. If these
are fewer than the dimensions, it shrinks in every direction they do not span, and the search converges before it has
found anything: this is why FEM fails on some runs of section 5.4.2 (20 samples in 42 dimensions). So by default Sigma
forgets more slowly than x, 0.5 / d; and its samples are seen from the old mean, from which they were drawn, because
seen from the new one they are (1 - alpha u)^2 too close. ``THESIS`` has the settings of section 5.4.2.

In local coordinates, z = x + A y, the last line is the rank-one update A <- A sqrt(1 - w) (I + (r - 1) y y^T / |y|^2),
so Sigma = A A^T is positive definite for ever.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dpsearch.search.arguments import flag, fraction, one_of, positive, shown, whole
from dpsearch.search.base import Matrix, Vector
from dpsearch.search.gaussian import GaussianSearch
from dpsearch.search.shaping import top_linear

COVARIANCES = ("full", "diagonal")
CENTRES = ("old", "new")
THESIS = {"forget_factor": 0.05, "covariance_forget_factor": 0.05, "centre": "new", "window": 50, "top": 5}
LEAST_EIGENVALUE = 1e-12  # of a fitted covariance, relative to the one before


class FEM(GaussianSearch):
    """Fitness expectation maximization; ask, tell and all else as in ``Search``.

    Args:
        x0: ``(d,)``, the initial mean.
        sigma0: Initial standard deviation: one number, or ``(d,)`` of them.
        online: Learn from each sample, so that ``ask`` gives one point at a time; else a generation at once.
        forget_factor: alpha in (0, 1], of the mean: 0.2 if None, in batches 0.5; 1 is maximum likelihood.
        covariance_forget_factor: alpha of the covariance: the smaller of 0.5 / d and ``forget_factor`` if None; in
            batches ``forget_factor``.
        centre: The mean from which samples are seen when the covariance is fitted, ``"old"`` or ``"new"``.
        window: How many of the last samples N, the newest one included, the newest is ranked among. Nothing is
            learned before there are as many. 25 if None. Online only; in batches, the population is ranked.
        top: How many of the window, or of the population, have a utility above 0: m, from 1 up linearly. 5 if None,
            in batches half of the population.
        covariance: ``"full"`` or ``"diagonal"``.
        elitist: The best sample so far never leaves the window.
        expansion: Factor of the samples' part in the new covariance; above 1 the distribution shrinks later.
        population: Samples of a batch, at least 2, 15 d if None; online there is but one.
        **options: See ``Search``.

    Attributes:
        repairs: How often a batch did not span all dimensions, so that its covariance had to be filled up. Online
            there is no need.

    Raises:
        ValueError: If an argument is out of range.
    """

    name = "fem"
    least_population = 1
    _saved = (*GaussianSearch._saved, "repairs", "_window")

    def __init__(
        self,
        x0: ArrayLike,
        sigma0: ArrayLike,
        *,
        online: bool = True,
        forget_factor: float | None = None,
        covariance_forget_factor: float | None = None,
        centre: str = "old",
        window: int | None = None,
        top: int | None = None,
        covariance: str = "full",
        elitist: bool = False,
        expansion: float = 1.0,
        population: int | None = None,
        **options: Any,
    ) -> None:
        self.online = flag("online", online)
        if online and (population is not None or options.get("importance_mixing")):
            raise ValueError(
                "population and importance_mixing are for batches (online=False); online there is a window"
            )
        if not online:
            population = 15 * np.size(x0) if population is None else whole("population", population, 2)
        self.diagonal = one_of("covariance", covariance, COVARIANCES) == "diagonal"
        self.window = 25 if window is None else whole("window", window, 1)
        super().__init__(x0, sigma0, population=1 if online else population, **options)
        usual = 0.2 if online else 0.5
        self.forget_factor = usual if forget_factor is None else fraction("forget_factor", forget_factor)
        slow = min(0.5 / self.dimension, self.forget_factor) if online else self.forget_factor
        self.covariance_forget_factor = fraction(
            "covariance_forget_factor",
            slow if covariance_forget_factor is None else covariance_forget_factor,
            one=not online,
        )
        self.centre = one_of("centre", centre, CENTRES)
        self.elitist = flag("elitist", elitist)
        self.expansion = positive("expansion", expansion)
        usual_top = min(5, self.ranked) if online else self.ranked // 2
        self.top = usual_top if top is None else whole("top", top, 1)
        if self.top > self.ranked:
            samples = f"{self.ranked}, the number of samples that are ranked"
            raise ValueError(f"top must be from 1 to {samples}, got {shown(top)}")
        self.repairs = 0
        self._unchanged = np.ones(self.dimension) if self.diagonal else np.eye(self.dimension)
        self._window = np.zeros(0)

    @property
    def ranked(self) -> int:
        """Number of samples that are ranked together: the window, or in batches the population."""
        return self.window if self.online else self.population

    def _step(self, local: Matrix, fitness: Vector) -> tuple[Vector, Matrix]:
        return self._sample_step(local[0], float(fitness[0])) if self.online else self._batch_step(local, fitness)

    def _sample_step(self, y: Vector, fitness: float) -> tuple[Vector, Matrix]:
        """Algorithm 5.1."""
        utility = self._rank(fitness)
        moved = self.forget_factor * utility
        forgotten = self.covariance_forget_factor * utility
        if forgotten == 0.0:
            return moved * y, self._unchanged
        nearer = 1.0 if self.centre == "old" else (1.0 - moved) ** 2
        kept, added = 1.0 - forgotten, self.expansion * forgotten * nearer
        if self.diagonal:
            return moved * y, np.sqrt(kept + added * y**2)
        root, length = np.sqrt(kept), y @ y
        # (longer - root) / |y|^2, written so that it holds where y is 0
        growth = added / (np.sqrt(kept + added * length) + root)
        return moved * y, root * np.eye(len(y)) + np.outer(growth * y, y)

    def _rank(self, fitness: float) -> float:
        """The utility of a new sample among the last of them; 0 while there are too few."""
        seen = self._window
        if len(seen) == self.window:
            oldest = 1 if self.elitist and len(seen) > 1 and seen[0] == seen.max() and (seen[1:] < seen[0]).all() else 0
            seen = np.delete(seen, oldest)
        self._window = np.append(seen, fitness)
        if len(self._window) < self.window:
            return 0.0
        better = int((seen > fitness).sum())
        rank = better + 0.5 * int((seen == fitness).sum())
        return max(0.0, 1.0 - rank / self.top)

    def _batch_step(self, local: Matrix, fitness: Vector) -> tuple[Vector, Matrix]:
        """Section 5.2.2: the Gaussian most likely to have produced the samples, weighted by utility."""
        utilities = top_linear(fitness, self.top)
        shares = utilities / utilities.sum()
        shift = self.forget_factor * (shares @ local)
        shares = self.covariance_forget_factor * shares
        spread = local - (shift if self.centre == "new" else 0.0)
        kept = 1.0 - self.covariance_forget_factor
        if self.diagonal:
            variance = kept + self.expansion * (shares @ spread**2)
            self.repairs += int((variance < LEAST_EIGENVALUE).any())
            return shift, np.sqrt(np.maximum(variance, LEAST_EIGENVALUE))
        covariance = kept * np.eye(len(shift)) + self.expansion * (spread.T * shares) @ spread
        values, vectors = np.linalg.eigh(covariance)
        self.repairs += int(values[0] < LEAST_EIGENVALUE)
        return shift, (vectors * np.sqrt(np.maximum(values, LEAST_EIGENVALUE))) @ vectors.T
