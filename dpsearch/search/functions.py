"""The twelve benchmark functions of table 4.1, and the rotation and shift that take their axes and origin away.

They are costs, to be minimised, of one point ``(d,)`` or of many ``(n, d)`` at once. To search, tell their negatives.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.stats import ortho_group

from dpsearch.search.base import Matrix, Vector


@dataclass(frozen=True)
class Function:
    """A benchmark function.

    Attributes:
        name: As in table 4.1.
        cost: Maps points ``(n, d)`` to costs ``(n,)``; least 0 at the origin, unless it is unbounded.
        unimodal: Whether it has one optimum.
        target: The cost that counts as reached (sections 4.7.1 and 4.7.2).
    """

    name: str
    cost: Callable[[Matrix], Vector]
    unimodal: bool
    target: float

    def __call__(self, z: Vector | Matrix) -> Vector:
        """The cost of one point ``(d,)``, or of each of the rows of ``(n, d)``."""
        costs = self.cost(np.atleast_2d(z))
        return costs if np.ndim(z) == 2 else costs[0]


@dataclass(frozen=True)
class Transformed:
    """A function whose argument is rotated and shifted: f(rotation (x - shift)).

    Attributes:
        function: f.
        rotation: ``(d, d)`` orthogonal.
        shift: ``(d,)``, where the optimum is.
    """

    function: Function
    rotation: Matrix
    shift: Vector

    def __call__(self, x: Vector | Matrix) -> Vector:
        """The cost of one point ``(d,)``, or of each of the rows of ``(n, d)``."""
        return self.function((x - self.shift) @ self.rotation.T)


def rotated_and_shifted(function: Function, dimension: int, seed: int) -> Transformed:
    """A function in a random orthonormal basis (uniform: Haar), with its optimum at a random place ~ N(0, I)."""
    generator = np.random.default_rng(seed)
    rotation = ortho_group.rvs(dimension, random_state=generator) if dimension > 1 else np.ones((1, 1))
    return Transformed(function, rotation, generator.standard_normal(dimension))


def sphere(z: Matrix) -> Vector:
    """Sum z_j^2."""
    return np.asarray((z**2).sum(axis=1))


def schwefel(z: Matrix) -> Vector:
    """sum_j (sum_{k <= j} z_k)^2, Schwefel's problem 1.2."""
    return np.asarray((z.cumsum(axis=1) ** 2).sum(axis=1))


def tablet(z: Matrix) -> Vector:
    """(1000 z_1)^2 + sum_{j >= 2} z_j^2."""
    return np.asarray((1000.0 * z[:, 0]) ** 2 + (z[:, 1:] ** 2).sum(axis=1))


def diff_pow(z: Matrix) -> Vector:
    """Sum |z_j|^(2 + 10 (j - 1) / (d - 1))."""
    return np.asarray((np.abs(z) ** (2.0 + 10.0 * _position(z))).sum(axis=1))


def ellipsoid(z: Matrix) -> Vector:
    """Sum (z_j 1000^((j - 1) / (d - 1)))^2."""
    return np.asarray(((z * 1000.0 ** _position(z)) ** 2).sum(axis=1))


def sharp_ridge(z: Matrix) -> Vector:
    """-z_1 + 100 sqrt(sum_{j >= 2} z_j^2): unbounded."""
    return np.asarray(-z[:, 0] + 100.0 * np.sqrt((z[:, 1:] ** 2).sum(axis=1)))


def parabolic_ridge(z: Matrix) -> Vector:
    """-z_1 + 100 sum_{j >= 2} z_j^2: unbounded."""
    return np.asarray(-z[:, 0] + 100.0 * (z[:, 1:] ** 2).sum(axis=1))


def cigar(z: Matrix) -> Vector:
    """z_1^2 + sum_{j >= 2} (1000 z_j)^2."""
    return np.asarray(z[:, 0] ** 2 + ((1000.0 * z[:, 1:]) ** 2).sum(axis=1))


def rastrigin(z: Matrix) -> Vector:
    """10 d + sum (z_j^2 - 10 cos(2 pi z_j))."""
    return np.asarray(10.0 * z.shape[1] + (z**2 - 10.0 * np.cos(2.0 * np.pi * z)).sum(axis=1))


def ackley(z: Matrix) -> Vector:
    """-20 exp(-0.2 sqrt(mean z^2)) - exp(mean cos(2 pi z)) + 20 + e."""
    waves = np.exp(np.cos(2.0 * np.pi * z).mean(axis=1))
    return np.asarray(20.0 - 20.0 * np.exp(-0.2 * np.sqrt((z**2).mean(axis=1))) + np.e - waves)


def weierstrass(z: Matrix) -> Vector:
    """sum_j sum_{k = 0..20} 0.5^k cos(2 pi 3^k (z_j + 0.5)), less its value at the origin."""
    k = np.arange(21)
    waves = 0.5**k * np.cos(2.0 * np.pi * 3.0**k * (z[..., None] + 0.5))
    least = 0.5**k * np.cos(np.pi * 3.0**k)
    return np.asarray((waves - least).sum(axis=(1, 2)))


def griewank(z: Matrix) -> Vector:
    """Sum z_j^2 / 4000 - prod cos(z_j / sqrt j) + 1."""
    waves = np.cos(z / np.sqrt(np.arange(1, z.shape[1] + 1))).prod(axis=1)
    return np.asarray((z**2).sum(axis=1) / 4000.0 - waves + 1.0)


def _position(z: Matrix) -> Vector:
    """(j - 1) / (d - 1) for every coordinate; 0 if there is only one."""
    return np.linspace(0.0, 1.0, z.shape[1])


FUNCTIONS = {
    function.name: function
    for function in (
        Function("Sphere", sphere, True, 1e-10),
        Function("Schwefel", schwefel, True, 1e-10),
        Function("Tablet", tablet, True, 1e-10),
        Function("DiffPow", diff_pow, True, 1e-10),
        Function("Ellipsoid", ellipsoid, True, 1e-10),
        Function("SharpR", sharp_ridge, True, -1000.0),
        Function("ParabR", parabolic_ridge, True, -1000.0),
        Function("Cigar", cigar, True, 1e-10),
        Function("Rastrigin", rastrigin, False, 0.01),
        Function("Ackley", ackley, False, 0.01),
        Function("Weierstrass", weierstrass, False, 0.01),
        Function("Griewank", griewank, False, 0.01),
    )
}
