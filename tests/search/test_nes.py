"""NES against algorithm 4.1 in global coordinates, and its gradients against what they define."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from dpsearch.search import NES
from dpsearch.search.nes import exact_gradient, regression_gradient
from tests.support.searches import Array, normals, valley


def shaped_costs(costs: Array) -> Array:
    """f' of section 4.4 for costs: minus (2i - 1 for i > 0.5, else 0), i = 1 for the least cost."""
    n = len(costs)
    i = np.array([sum(other > cost for other in costs) / (n - 1) for cost in costs])
    return -np.where(i > 0.5, 2 * i - 1, 0.0)


class Algorithm41:
    """The pseudocode, line by line: theta = (x, A), Sigma = A^T A, A upper triangular, costs, no importance mixing."""

    def __init__(self, x: Array, A: Array, alpha: float) -> None:
        self.x, self.A, self.alpha = x, A, alpha

    def draw(self, y: Array) -> Array:
        return np.array([self.x + self.A.T @ y_k for y_k in y])

    def update(self, z: Array, costs: Array) -> None:
        sigma_inverse = np.linalg.inv(self.A.T @ self.A)
        upper = np.triu_indices(len(self.x))
        phi = []
        for z_k in z:
            grad_x = sigma_inverse @ (z_k - self.x)
            outer = np.outer(z_k - self.x, z_k - self.x)
            grad_sigma = 0.5 * sigma_inverse @ outer @ sigma_inverse - 0.5 * sigma_inverse
            grad_A = self.A @ (grad_sigma + grad_sigma.T)
            phi.append(np.concatenate([grad_x, grad_A[upper], [1.0]]))
        delta = np.linalg.pinv(np.array(phi)) @ shaped_costs(costs)
        self.x = self.x - self.alpha * delta[: len(self.x)]
        self.A = self.A.copy()
        self.A[upper] -= self.alpha * delta[len(self.x) : -1]


@pytest.mark.parametrize("alpha", [1.0, 0.3])
def test_the_additive_update_is_algorithm_41_word_for_word(alpha: float) -> None:
    x0, sigma0 = np.array([1.0, -0.5, 2.0]), np.array([0.5, 1.0, 2.0])
    search = NES(x0, sigma0, update="additive", importance_mixing=False, learning_rate=alpha, seed=5)
    twin = Algorithm41(x0, np.diag(sigma0), alpha)
    for g in range(12):
        z = twin.draw(normals(5, g, 45, 3))
        np.testing.assert_allclose(search.ask(), z, rtol=0, atol=1e-8)
        costs = np.array([valley(z_k) for z_k in z])
        twin.update(z, costs)
        search.tell(search.ask(), -costs)
        np.testing.assert_allclose(search.mean, twin.x, rtol=0, atol=1e-8)
        np.testing.assert_allclose(search.factor, twin.A.T, rtol=0, atol=1e-8)
    assert np.abs(np.tril(twin.A.T, -1)).max() > 0.01  # the axes did get correlated


def test_the_exponential_update_is_algorithm_41_to_first_order() -> None:
    x, A = np.array([0.3, -0.2, 0.1]), np.array([[1.0, 0.4, -0.3], [0.0, 0.7, 0.2], [0.0, 0.0, 0.5]])
    gaps, moved = [], []
    for alpha in (1e-2, 1e-3):
        search = NES(x, 1.0, importance_mixing=False, learning_rate=alpha, seed=1)
        search.load_state_dict({**search.state_dict(), "factor": A.T})
        twin = Algorithm41(x, A, alpha)
        z = search.ask()
        costs = np.array([valley(z_k) for z_k in z])
        search.tell(z, -costs)
        twin.update(z, costs)
        np.testing.assert_allclose(search.mean, twin.x, rtol=0, atol=1e-12)
        gaps.append(np.abs(search.factor @ search.factor.T - twin.A.T @ twin.A).max())
        moved.append(np.abs(twin.A.T @ twin.A - A.T @ A).max())
    assert gaps[0] / gaps[1] == pytest.approx(100.0, rel=0.1)
    assert moved[0] / moved[1] == pytest.approx(10.0, rel=0.1)


def quadratic(y: Array, g: Array, m: Array, c: float) -> Array:
    return np.array([y_k @ g + y_k @ m @ y_k + c for y_k in y])


@pytest.mark.parametrize("n", [15, 16, 200])
def test_regression_finds_a_linear_and_quadratic_fitness_exactly(n: int) -> None:
    rng = np.random.default_rng(n)
    y, g, m = rng.standard_normal((n, 4)), rng.standard_normal(4), rng.standard_normal((4, 4))
    m = m + m.T
    shift, found = regression_gradient(y, quadratic(y, g, m, 3.0))
    np.testing.assert_allclose(shift, g, rtol=0, atol=1e-7)
    np.testing.assert_allclose(found, m, rtol=0, atol=1e-7)


def scaled_features(y: Array) -> Array:
    """Columns orthonormal under N(0, I)."""
    d = y.shape[1]
    columns = [y[:, i] for i in range(d)]
    columns += [y[:, i] * y[:, j] for i, j in itertools.combinations(range(d), 2)]
    columns += [(y[:, i] ** 2 - 1) / np.sqrt(2) for i in range(d)]
    return np.stack([*columns, np.ones(len(y))], axis=1)


def quadrature(d: int) -> tuple[Array, Array]:
    """Points and weights of Gauss-Hermite: expectations under N(0, I), exact for polynomials up to degree 39."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(20)
    points = np.array(list(itertools.product(nodes, repeat=d)))
    products = np.array([np.prod(w) for w in itertools.product(weights / weights.sum(), repeat=d)])
    return points, products


@pytest.mark.parametrize(("n", "repeated"), [(7, 1), (12, 2), (20, 1)])
def test_regression_on_few_points_is_the_shortest_in_the_fisher_metric(n: int, repeated: int) -> None:
    rng = np.random.default_rng(n)
    y = np.tile(rng.standard_normal((n, 5)), (repeated, 1))  # 21 parameters; repeated: singular normal equations
    u = rng.standard_normal(len(y))
    shift, m = regression_gradient(y, u)
    expected = np.linalg.lstsq(scaled_features(y), u, rcond=None)[0]
    np.testing.assert_allclose(shift, expected[:5], rtol=0, atol=1e-9)
    off = [m[i, j] * 2 for i, j in itertools.combinations(range(5), 2)]
    np.testing.assert_allclose(off, expected[5:15], rtol=0, atol=1e-9)
    np.testing.assert_allclose(np.diag(m) * np.sqrt(2), expected[15:20], rtol=0, atol=1e-9)
    np.testing.assert_allclose(m, m.T, rtol=0, atol=1e-14)


@pytest.mark.parametrize("extent", [0.0, 1e-8])
@pytest.mark.parametrize("n", [12, 18, 60])
def test_regression_says_nothing_of_an_axis_without_extent(n: int, extent: float) -> None:
    rng = np.random.default_rng(n)
    y, u = rng.standard_normal((n, 4)), rng.standard_normal(n)
    y[:, 0] *= extent
    shift, m = regression_gradient(y, u)
    shortest = np.linalg.lstsq(scaled_features(y), u, rcond=1e-7)[0][:-1]
    assert np.sqrt(shift @ shift + 2 * (m**2).sum()) == pytest.approx(np.linalg.norm(shortest), rel=1e-6)


def test_regressors_are_orthonormal_and_the_fisher_matrix_of_m_is_twice_the_identity() -> None:
    points, weights = quadrature(3)
    features = scaled_features(points)
    np.testing.assert_allclose((features.T * weights) @ features, np.eye(10), rtol=0, atol=1e-12)
    rng = np.random.default_rng(0)
    m, k = rng.standard_normal((2, 3, 3))
    m, k = m + m.T, k + k.T
    centred = points[:, :, None] * points[:, None, :] - np.eye(3)  # grad_M log pi at M = 0, (n, 3, 3)
    inner = weights @ ((centred * m).sum((1, 2)) * (centred * k).sum((1, 2)))
    assert inner == pytest.approx(2 * (m * k).sum(), rel=1e-12)


def test_the_length_of_a_step_is_its_kullback_leibler_divergence() -> None:
    rng = np.random.default_rng(3)
    shift, m = rng.standard_normal(3), rng.standard_normal((3, 3))
    m = m + m.T
    h = 1e-3
    covariance = np.linalg.matrix_power(np.eye(3) + h * m / 64, 128)  # exp(h M)^2, nearly
    divergence = 0.5 * (np.trace(covariance) + h**2 * shift @ shift - 3 - np.linalg.slogdet(covariance)[1])
    assert divergence / h**2 == pytest.approx(0.5 * shift @ shift + (m**2).sum(), rel=1e-2)


def utility(y: Array) -> Array:
    return np.asarray(np.tanh(y[:, 0] + 0.5 * y[:, 1]) + np.exp(-((y[:, 0] - y[:, 1]) ** 2)) + 2.0)


def test_both_gradients_tend_to_the_natural_gradient() -> None:
    points, weights = quadrature(2)
    g = weights @ (utility(points)[:, None] * points)
    m = 0.5 * np.einsum("n,nij->ij", weights * utility(points), points[:, :, None] * points[:, None, :] - np.eye(2))
    y = np.random.default_rng(0).standard_normal((100_000, 2))
    for gradient in (regression_gradient, exact_gradient):
        shift, found = gradient(y, utility(y))
        np.testing.assert_allclose(shift, g, rtol=0, atol=0.01)
        np.testing.assert_allclose(found, m, rtol=0, atol=0.01)
    assert min(np.abs(g).min(), np.abs(m).min()) > 0.02


def test_the_exact_gradient_is_the_written_sum_and_ignores_a_constant() -> None:
    y = np.random.default_rng(1).standard_normal((9, 3))
    u = np.arange(9.0) ** 2
    g = sum((u[k] - u.mean()) * y[k] for k in range(9)) / 9
    m = sum((u[k] - u.mean()) * (np.outer(y[k], y[k]) - np.eye(3)) / 2 for k in range(9)) / 9
    for constant in (0.0, 100.0):
        shift, found = exact_gradient(y, u + constant)
        np.testing.assert_allclose(shift, g, rtol=1e-9)
        np.testing.assert_allclose(found, m, rtol=0, atol=1e-10)


@pytest.mark.parametrize("gradient", ["regression", "exact"])
def test_on_a_plateau_nothing_moves(gradient: str) -> None:
    search = NES(np.ones(3), 0.5, gradient=gradient, seed=0)
    for _ in range(5):
        search.tell(search.ask(), np.full(len(search.ask()), 7.0))
    np.testing.assert_allclose(search.mean, 1.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(search.factor, 0.5 * np.eye(3), rtol=0, atol=1e-12)


def test_the_population_is_fifteen_times_the_dimension() -> None:
    assert len(NES(np.zeros(4), 1.0, seed=0).ask()) == 60


@pytest.mark.parametrize("option", ["gradient", "update"])
def test_an_unknown_gradient_or_update_is_refused(option: str) -> None:
    with pytest.raises(ValueError, match=f"{option} must be one of .*'vanilla'"):
        NES(np.zeros(2), 1.0, **{option: "vanilla"})  # type: ignore[arg-type]


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf])
def test_a_learning_rate_that_is_not_positive_is_refused(rate: float) -> None:
    with pytest.raises(ValueError, match="learning_rate must be positive"):
        NES(np.zeros(2), 1.0, learning_rate=rate)


def test_a_diagonal_covariance_is_not_on_offer() -> None:
    with pytest.raises(TypeError, match="diagonal"):
        NES(np.zeros(2), 1.0, diagonal=True)
