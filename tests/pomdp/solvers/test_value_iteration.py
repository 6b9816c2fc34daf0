import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.solvers.agents import fully_observed
from dpsearch.pomdp.solvers.exact import exact_metrics
from dpsearch.pomdp.solvers.value_iteration import value_iteration
from dpsearch.pomdp.task import tabular_task
from tests.support.optima import STATE_KNOWN, TASKS, assert_as_printed, task


def dense(pomdp: TabularPOMDP) -> NDArray[np.float64]:
    """Probability of each next state, ``(A, S, S)``."""
    return np.stack([pomdp.transition_matrix(action) for action in range(pomdp.n_actions)])


def test_the_values_solve_the_linear_program(noisy_pomdp: TabularPOMDP) -> None:
    """The least values that no action exceeds (d'Epenoux, 1963)."""
    states, actions = noisy_pomdp.n_states, noisy_pomdp.n_actions
    rows = noisy_pomdp.discount * dense(noisy_pomdp).reshape(-1, states) - np.tile(np.eye(states), (actions, 1))
    least = linprog(np.ones(states), rows, -noisy_pomdp.expected_rewards().T.ravel(), bounds=(None, None))
    solution = value_iteration(noisy_pomdp)
    np.testing.assert_allclose(solution.values, least.x, atol=1e-8)
    assert solution.start_value == pytest.approx(noisy_pomdp.start_distribution() @ least.x)


@pytest.mark.parametrize("name", TASKS)
def test_the_policy_earns_the_values(name: str) -> None:
    pomdp = task(name).pomdp
    discount = min(pomdp.discount, 0.999)
    solution = value_iteration(pomdp, discount)
    state = np.arange(pomdp.n_states)
    moves, rewards = dense(pomdp)[solution.policy, state], pomdp.expected_rewards()[state, solution.policy]
    earned = np.linalg.solve(np.eye(pomdp.n_states) - discount * moves, rewards)
    np.testing.assert_allclose(solution.values, earned, atol=1e-7)
    np.testing.assert_allclose(solution.values, solution.action_values.max(axis=1))


@pytest.mark.parametrize(("name", "value"), [("shuttle", 14.50371), ("maze89", 0.79605), ("tmaze 5", 3.61568)])
def test_the_optimum_is_what_was_computed_elsewhere(name: str, value: float) -> None:
    assert value_iteration(task(name).pomdp).start_value == pytest.approx(value, abs=6e-6)


def test_who_sees_the_state_of_maze89_achieves_what_was_computed_elsewhere() -> None:
    seen = tabular_task(fully_observed(task("maze89").pomdp), 251)
    assert_as_printed(exact_metrics(seen, value_iteration(seen.pomdp).controller()), STATE_KNOWN["maze89"])


def test_without_discount_the_value_is_the_return() -> None:
    seen = tabular_task(fully_observed(task("maze4x3").pomdp), 1_000)
    solution = value_iteration(seen.pomdp)
    assert exact_metrics(seen, solution.controller()).episode_return.value == pytest.approx(solution.start_value)


def test_with_a_step_cap_the_value_is_what_backward_induction_finds() -> None:
    shuttle = task("shuttle").pomdp
    assert value_iteration(shuttle, 1.0, steps=1_000).start_value == pytest.approx(1838.454, abs=6e-4)
    assert value_iteration(shuttle, steps=0).start_value == 0.0
    one_left = value_iteration(shuttle, 1.0, steps=1)
    np.testing.assert_array_equal(one_left.values, shuttle.expected_rewards().max(axis=1))


def test_of_equal_actions_the_first_is_taken() -> None:
    both = TabularPOMDP.from_dense(np.ones((2, 1, 1)), np.ones((2, 1, 1)), 1.0, [1.0], discount=0.5)
    assert value_iteration(both).policy.tolist() == [0]
    assert value_iteration(both).start_value == pytest.approx(2)


def test_values_that_grow_for_ever_are_reported() -> None:
    endless = TabularPOMDP.from_dense(np.ones((1, 1, 1)), np.ones((1, 1, 1)), 1.0, [1.0])
    with pytest.raises(ArithmeticError, match="have not settled"):
        value_iteration(endless)
