"""SNES, separable natural evolution strategies: a diagonal covariance, for many dimensions.

Wierstra, Schaul, Glasmachers, Sun, Peters and Schmidhuber, "Natural evolution strategies", JMLR 15, 2014, section 3.5.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dpsearch.search.arguments import positive
from dpsearch.search.base import Matrix, Vector
from dpsearch.search.gaussian import GaussianSearch
from dpsearch.search.shaping import log_rank
from dpsearch.search.xnes import LARGEST_EXPONENT


class SNES(GaussianSearch):
    """Separable NES; ask, tell and all else as in ``Search``.

    Args:
        x0: ``(d,)``, the initial mean.
        sigma0: Initial standard deviation: one number, or ``(d,)`` of them.
        learning_rate: Step size of the mean, eta_mu.
        sigma_learning_rate: Step size of the logarithms of the standard deviations, eta_sigma;
            (3 + ln d) / (5 sqrt d) if None.
        **options: See ``GaussianSearch``.

    Raises:
        ValueError: If an argument is out of range.
    """

    name = "snes"
    diagonal = True

    def __init__(
        self,
        x0: ArrayLike,
        sigma0: ArrayLike,
        *,
        learning_rate: float = 1.0,
        sigma_learning_rate: float | None = None,
        **options: Any,
    ) -> None:
        super().__init__(x0, sigma0, **options)
        d = self.dimension
        usual = float((3 + np.log(d)) / (5 * np.sqrt(d)))
        self.learning_rate = positive("learning_rate", learning_rate)
        self.sigma_learning_rate = (
            usual if sigma_learning_rate is None else positive("sigma_learning_rate", sigma_learning_rate)
        )

    def _step(self, local: Matrix, fitness: Vector) -> tuple[Vector, Matrix]:
        utilities = log_rank(fitness)
        shift = self.learning_rate * (utilities @ local)
        exponent = 0.5 * self.sigma_learning_rate * (utilities @ (local**2 - 1.0))
        return shift, np.exp(np.clip(exponent, -LARGEST_EXPONENT, LARGEST_EXPONENT))
