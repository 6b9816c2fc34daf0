"""xNES, exponential natural evolution strategies: the natural gradient in closed form, in exponential coordinates.

Glasmachers, Schaul, Sun, Wierstra and Schmidhuber, "Exponential natural evolution strategies", GECCO 2010. Adaptation
sampling: Wierstra, Schaul, Glasmachers, Sun, Peters and Schmidhuber, "Natural evolution strategies", JMLR 15, 2014,
section 4.2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from dpsearch.search.arguments import flag, positive
from dpsearch.search.base import Matrix, Vector
from dpsearch.search.gaussian import GaussianSearch
from dpsearch.search.shaping import log_rank

DECAY = 0.1  # how fast adaptation sampling changes the learning rate, c' in the paper
LARGEST_EXPONENT = 3.0  # twentyfold in a generation: beyond lies only what comes of points that were not drawn
BOLDNESS = 1.5  # how much larger a learning rate it tries in thought


class XNES(GaussianSearch):
    """Exponential NES; ask, tell and all else as in ``Search``.

    Args:
        x0: ``(d,)``, the initial mean.
        sigma0: Initial standard deviation: one number, or ``(d,)`` of them.
        learning_rate: Step size of the mean, eta_mu.
        sigma_learning_rate: Step size of the scale, eta_sigma; (9 + 3 ln d) / (5 d sqrt d) if None.
        shape_learning_rate: Step size of the shape, eta_B; as ``sigma_learning_rate`` if None.
        adaptation_sampling: Adapt the step size of the scale: raise it as long as samples reweighted for a larger
            one would not have ranked worse, else let it fall back.
        **options: See ``GaussianSearch``.

    Raises:
        ValueError: If an argument is out of range.
    """

    name = "xnes"
    _saved = (*GaussianSearch._saved, "sigma_learning_rate", "_boldness")

    def __init__(
        self,
        x0: ArrayLike,
        sigma0: ArrayLike,
        *,
        learning_rate: float = 1.0,
        sigma_learning_rate: float | None = None,
        shape_learning_rate: float | None = None,
        adaptation_sampling: bool = False,
        **options: Any,
    ) -> None:
        super().__init__(x0, sigma0, **options)
        d = self.dimension
        usual = float((9 + 3 * np.log(d)) / (5 * d * np.sqrt(d)))
        self.learning_rate = positive("learning_rate", learning_rate)
        self.sigma_learning_rate = (
            usual if sigma_learning_rate is None else positive("sigma_learning_rate", sigma_learning_rate)
        )
        self.shape_learning_rate = (
            self.sigma_learning_rate
            if shape_learning_rate is None
            else positive("shape_learning_rate", shape_learning_rate)
        )
        self.adaptation_sampling = flag("adaptation_sampling", adaptation_sampling)
        self._least_rate = self.sigma_learning_rate
        self._boldness = 0.0  # logarithm of how much wider the distribution would be had its last step been bolder

    def _step(self, local: Matrix, fitness: Vector) -> tuple[Vector, Matrix]:
        if self.adaptation_sampling and self.generations > 0:
            self._adapt(local, fitness)
        utilities = log_rank(fitness)
        gradient = (local.T * utilities) @ local - utilities.sum() * np.eye(self.dimension)  # for M, (d, d)
        scale = np.trace(gradient) / self.dimension
        shape = gradient - scale * np.eye(self.dimension)
        self._boldness = float(0.5 * (BOLDNESS - 1.0) * self.sigma_learning_rate * scale)
        exponent = 0.5 * (self.sigma_learning_rate * scale * np.eye(self.dimension) + self.shape_learning_rate * shape)
        return self.learning_rate * (utilities @ local), matrix_exponential(exponent)

    def _adapt(self, local: Matrix, fitness: Vector) -> None:
        """Adaptation sampling: would the last step, with a larger step size, have given better samples than these?"""
        wider = np.exp(self._boldness)
        weights = np.exp(0.5 * (local**2).sum(axis=1) * (1.0 - wider**-2)) / wider**self.dimension
        level = 0.5 - 1.0 / (3 * (self.dimension + 1))
        if mann_whitney(fitness, weights) < level:
            rate = (1 - DECAY) * self.sigma_learning_rate + DECAY * self._least_rate
        else:
            rate = min((1 + DECAY) * self.sigma_learning_rate, 1.0)
        self.sigma_learning_rate = float(rate)


def mann_whitney(fitness: Vector, weights: Vector) -> float:
    """Probability that samples with these weights are better than samples with weight 1.

    The weighted Mann-Whitney test: 0.5 if the weights say nothing, 1 if they favour the fit without doubt.
    """
    order = np.argsort(fitness, kind="stable")
    ranked, w = fitness[order], weights[order]
    below = np.searchsorted(ranked, ranked, side="left")
    equal = np.searchsorted(ranked, ranked, side="right") - below
    n, total = len(w), w.sum()
    u = (w * (below + 0.5 * equal)).sum()
    deviation = np.sqrt(n * total * (n + total + 1) / 12)
    return float(ndtr((u - 0.5 * n * total) / deviation))


def matrix_exponential(symmetric: Matrix) -> Matrix:
    """Exp of a symmetric matrix: symmetric and positive definite.

    Its eigenvalues are limited to +-``LARGEST_EXPONENT``.
    """
    values, vectors = np.linalg.eigh(symmetric)
    return np.asarray((vectors * np.exp(np.clip(values, -LARGEST_EXPONENT, LARGEST_EXPONENT))) @ vectors.T)
