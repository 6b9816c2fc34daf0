"""The benchmark functions against loops written from table 4.1."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import cos, e, exp, pi, prod, sqrt

import numpy as np
import pytest

from dpsearch.search.functions import FUNCTIONS, rotated_and_shifted


def weierstrass(z: Sequence[float]) -> float:
    def term(z_j: float) -> float:
        return sum(0.5**k * cos(2 * pi * 3**k * (z_j + 0.5)) for k in range(21))

    return sum(term(z_j) - term(0.0) for z_j in z)


WRITTEN: dict[str, Callable[[Sequence[float]], float]] = {
    "Sphere": lambda z: sum(x**2 for x in z),
    "Schwefel": lambda z: sum(sum(z[: j + 1]) ** 2 for j in range(len(z))),
    "Tablet": lambda z: (1000 * z[0]) ** 2 + sum(x**2 for x in z[1:]),
    "DiffPow": lambda z: sum(abs(x) ** (2 + 10 * j / (len(z) - 1)) for j, x in enumerate(z)),
    "Ellipsoid": lambda z: sum((x * 1000 ** (j / (len(z) - 1))) ** 2 for j, x in enumerate(z)),
    "SharpR": lambda z: -z[0] + 100 * sqrt(sum(x**2 for x in z[1:])),
    "ParabR": lambda z: -z[0] + 100 * sum(x**2 for x in z[1:]),
    "Cigar": lambda z: z[0] ** 2 + sum((1000 * x) ** 2 for x in z[1:]),
    "Rastrigin": lambda z: 10 * len(z) + sum(x**2 - 10 * cos(2 * pi * x) for x in z),
    "Ackley": lambda z: (
        -20 * exp(-0.2 * sqrt(sum(x**2 for x in z) / len(z))) - exp(sum(cos(2 * pi * x) for x in z) / len(z)) + 20 + e
    ),
    "Weierstrass": weierstrass,
    "Griewank": lambda z: sum(x**2 for x in z) / 4000 - prod(cos(x / sqrt(j)) for j, x in enumerate(z, start=1)) + 1,
}
UNBOUNDED = {"SharpR", "ParabR"}


def test_there_are_the_twelve_of_the_table() -> None:
    assert list(FUNCTIONS) == list(WRITTEN)
    assert [name for name, f in FUNCTIONS.items() if not f.unimodal] == list(WRITTEN)[8:]
    assert {f.target for f in FUNCTIONS.values()} == {1e-10, 0.01, -1000.0}


@pytest.mark.parametrize("name", WRITTEN)
@pytest.mark.parametrize("d", [2, 5, 15])
def test_a_function_is_its_formula_for_one_point_and_for_many(name: str, d: int) -> None:
    points = np.random.default_rng(d).normal(0.0, 2.0, (20, d))
    expected = [WRITTEN[name](z.tolist()) for z in points]
    together = FUNCTIONS[name](points)
    assert together.shape == (20,)
    np.testing.assert_allclose(together, expected, rtol=1e-10, atol=1e-9)
    single = [FUNCTIONS[name](z) for z in points]
    assert all(np.ndim(f) == 0 for f in single)
    np.testing.assert_allclose(single, together, rtol=1e-13)


@pytest.mark.parametrize("name", sorted(set(WRITTEN) - UNBOUNDED))
@pytest.mark.parametrize("d", [1, 2, 5])
def test_the_least_cost_is_zero_at_the_origin(name: str, d: int) -> None:
    function = FUNCTIONS[name]
    assert function(np.zeros(d)) == pytest.approx(0.0, abs=1e-12)
    rng = np.random.default_rng(d)
    for scale in (1e-2, 1.0, 10.0):
        assert (function(rng.normal(0.0, scale, (2000, d))) > 0.0).all()


@pytest.mark.parametrize("name", sorted(UNBOUNDED))
def test_the_ridges_have_no_least_cost(name: str) -> None:
    far = np.zeros((3, 4))
    far[:, 0] = 1e3, 1e6, 1e9
    np.testing.assert_array_equal(FUNCTIONS[name](far), -far[:, 0])


def test_a_rotation_is_orthogonal_and_of_its_own_seed() -> None:
    for d in (1, 2, 5):
        rotation = rotated_and_shifted(FUNCTIONS["Sphere"], d, 3).rotation
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(d), rtol=0, atol=1e-12)
    first, again, other = (rotated_and_shifted(FUNCTIONS["Sphere"], 4, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.rotation, again.rotation)
    np.testing.assert_array_equal(first.shift, again.shift)
    assert (first.rotation != other.rotation).all()
    assert (first.shift != other.shift).all()


def test_rotations_favour_no_direction_and_shifts_are_normal() -> None:
    drawn = [rotated_and_shifted(FUNCTIONS["Sphere"], 3, seed) for seed in range(2000)]
    entries = np.array([t.rotation for t in drawn])
    # Haar: E r_ij = 0, E r_ij^2 = 1/d, E r_ij^4 = 3 / (d (d + 2)), E r_ij r_kl = 0
    np.testing.assert_allclose(entries.mean(axis=0), 0.0, atol=0.05)
    np.testing.assert_allclose((entries**2).mean(axis=0), 1 / 3, atol=0.03)
    np.testing.assert_allclose((entries**4).mean(axis=0), 1 / 5, atol=0.03)
    pairs = np.einsum("nij,nkl->ijkl", entries, entries) / len(entries)
    assert np.abs(pairs.reshape(9, 9) - np.eye(9) / 3).max() < 0.05
    shifts = np.array([t.shift for t in drawn])
    np.testing.assert_allclose(shifts.mean(axis=0), 0.0, atol=0.1)
    np.testing.assert_allclose(np.cov(shifts.T), np.eye(3), atol=0.1)


@pytest.mark.parametrize("name", ["Ellipsoid", "Griewank"])
def test_a_transformed_function_is_the_function_of_the_rotated_difference(name: str) -> None:
    transformed = rotated_and_shifted(FUNCTIONS[name], 4, 8)
    assert transformed(transformed.shift) == pytest.approx(0.0, abs=1e-12)
    points = np.random.default_rng(0).standard_normal((6, 4))
    expected = [WRITTEN[name]((transformed.rotation @ (x - transformed.shift)).tolist()) for x in points]
    np.testing.assert_allclose(transformed(points), expected, rtol=1e-10)
    np.testing.assert_allclose([transformed(x) for x in points], expected, rtol=1e-10)
