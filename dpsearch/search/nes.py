"""NES, natural evolution strategies: chapter 4 of the thesis, algorithm 4.1.

A generation of points z ~ N(x, A^T A) is shaped by rank, and the search distribution follows the natural gradient of
its expected fitness, which is a linear regression (section 4.6):

    delta theta = (Phi^T Phi)^-1 Phi^T R,      Phi = [grad_x log pi(z_k), grad_A log pi(z_k), 1]

The one thing to understand: in local coordinates, z = x + A^T y, the regressors become y, y y^T - I and 1, whatever
x and A are. So the regression stays well conditioned to the end of the search, and the steps found,
x + A^T shift and A <- exp(M) A, are those of algorithm 4.1 to first order.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import lapack

from dpsearch.search.arguments import one_of, positive
from dpsearch.search.base import Matrix, Vector
from dpsearch.search.gaussian import GaussianSearch
from dpsearch.search.shaping import relative_rank
from dpsearch.search.xnes import matrix_exponential

GRADIENTS = ("regression", "exact")
UPDATES = ("exponential", "additive")


class NES(GaussianSearch):
    """Natural evolution strategies as in the thesis; ask, tell and all else as in ``Search``.

    Args:
        x0: ``(d,)``, the initial mean.
        sigma0: Initial standard deviation: one number, or ``(d,)`` of them.
        learning_rate: Step size alpha.
        gradient: ``"regression"``: as above; where there are fewer points than parameters, the shortest solution.
            ``"exact"``: with the Fisher matrix in closed form, which in local coordinates is diagonal (Sun, Wierstra,
            Schaul and Schmidhuber, "Efficient natural evolution strategies", GECCO 2009), and the mean utility as
            the fitness baseline.
        update: ``"exponential"``: A <- exp(M) A, always of full rank. ``"additive"``: A <- A + delta A with A upper
            triangular, word for word as in algorithm 4.1.
        importance_mixing: Evaluate only the points that the last generation does not provide (section 4.5).
        **options: See ``GaussianSearch``. The population is 15 d by default.

    Raises:
        ValueError: If an argument is out of range.
    """

    name = "nes"

    def __init__(
        self,
        x0: ArrayLike,
        sigma0: ArrayLike,
        *,
        learning_rate: float = 1.0,
        gradient: str = "regression",
        update: str = "exponential",
        importance_mixing: bool = True,
        **options: Any,
    ) -> None:
        super().__init__(x0, sigma0, importance_mixing=importance_mixing, **options)
        self.learning_rate = positive("learning_rate", learning_rate)
        self.gradient = one_of("gradient", gradient, GRADIENTS)
        self.update = one_of("update", update, UPDATES)

    @staticmethod
    def default_population(dimension: int) -> int:
        """15 d (section 4.7)."""
        return 15 * dimension

    def _step(self, local: Matrix, fitness: Vector) -> tuple[Vector, Matrix]:
        utilities = relative_rank(fitness)
        natural = regression_gradient if self.gradient == "regression" else exact_gradient
        shift, m = natural(local, utilities)
        if self.update == "exponential":
            return self.learning_rate * shift, matrix_exponential(self.learning_rate * m)
        # A <- (I + alpha T) A with T upper triangular and T + T^T = 2 M; the factor is A^T
        return self.learning_rate * shift, np.eye(self.dimension) + self.learning_rate * (np.tril(m, -1) + np.tril(m))


def regression_gradient(local: Matrix, utilities: Vector) -> tuple[Vector, Matrix]:
    """Least squares fit of utilities by y, y y^T - I and 1: the coefficients (shift ``(d,)``, M ``(d, d)``).

    Regressors are scaled so that they are orthonormal under N(0, I). Then the shortest of several solutions is the one
    nearest to the old distribution in terms of the Kullback-Leibler divergence.
    """
    n, d = local.shape
    if n < 1 + d + d * (d + 1) // 2:
        return _from_inner_products(local, utilities)
    from dpsearch.search.normal_equations import (
        normal_equations,  # now, as importing Numba takes longer than many a search
    )

    b, a, scale = _products(d)
    gram, right = np.empty((len(b), len(b))), np.empty(len(b))
    normal_equations(np.ascontiguousarray(local), utilities, gram, right)
    coefficients = np.zeros((d + 1, d + 1))
    coefficients[b, a] = scale * _solve(gram, right)
    m = coefficients[1:, 1:]
    return coefficients[1:, 0], m + m.T


def _from_inner_products(local: Matrix, utilities: Vector) -> tuple[Vector, Matrix]:
    """The same where parameters are more than points: they are sums over the points, of which there are n to find."""
    dots = local @ local.T
    squares = np.diag(dots)
    gram = dots + 0.5 * (dots**2 - squares[:, None] - squares + local.shape[1]) + 1.0
    weights = _solve(gram, utilities)
    return weights @ local, 0.5 * ((local.T * weights) @ local - weights.sum() * np.eye(local.shape[1]))


def exact_gradient(local: Matrix, utilities: Vector) -> tuple[Vector, Matrix]:
    """Mean of (u - baseline) y, and of (u - baseline) (y y^T - I) / 2: the Fisher matrix of M is 2 I."""
    advantages = (utilities - utilities.mean()) / len(utilities)
    return advantages @ local, 0.5 * (local.T * advantages) @ local


@cache
def _products(d: int) -> tuple[NDArray[np.intp], NDArray[np.intp], Vector]:
    """Place of each coefficient in a matrix, and its meaning: half of M's symmetric pair, or the shift."""
    b, a = np.tril_indices(d + 1)
    return b, a, np.where(a == 0, 1.0, np.where(a == b, np.sqrt(0.125), 0.5))


def _solve(gram: Matrix, right: Vector) -> Vector:
    """The shortest solution of normal equations, of which only the upper triangle need be there."""
    factor, solution, info = lapack.dposv(gram.T, right, lower=1)
    diagonal = factor.diagonal()
    if info == 0 and diagonal.min() > 1e-6 * diagonal.max():
        return np.asarray(solution)
    return np.asarray(np.linalg.lstsq(np.triu(gram) + np.triu(gram, 1).T, right, rcond=None)[0])
