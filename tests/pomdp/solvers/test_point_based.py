import numpy as np
import pytest

from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.solvers.exact import controller_of, exact_metrics
from dpsearch.pomdp.solvers.play import play
from dpsearch.pomdp.solvers.point_based import Model, point_based
from dpsearch.pomdp.solvers.value_iteration import value_iteration
from dpsearch.pomdp.task import tabular_task
from tests.support.optima import OPTIMAL, assert_as_printed, task


@pytest.mark.parametrize("name", OPTIMAL)
def test_the_optimum_is_what_was_computed_elsewhere_in_every_metric(name: str) -> None:
    played = task(name)
    bound = point_based(played.pomdp)
    assert bound.start_value == pytest.approx(float(OPTIMAL[name].split()[3]), abs=6e-6)
    assert_as_printed(exact_metrics(played, controller_of(bound.agent())), OPTIMAL[name])


@pytest.mark.parametrize(("name", "low", "high"), [("maze4x3", 0.761, 0.7622), ("maze4x3, minus ends", 0.6970, 0.6976)])
def test_the_bound_of_the_4x3_maze_lies_where_it_must_and_its_policy_earns_it(
    name: str, low: float, high: float
) -> None:
    played = task(name)
    bound = point_based(played.pomdp, 0.9999)
    assert low < bound.start_value < high
    earned = play(played, bound.agent(), 10_000).metrics().episode_return
    assert abs(earned.value - bound.start_value) < 4 * earned.standard_error


def test_in_maze89_a_rough_bound_already_has_a_good_policy() -> None:
    played = task("maze89")
    bound = point_based(played.pomdp, rounds=3, beliefs=60, sweeps=40, tolerance=1e-3)
    found = play(played, bound.agent(), 2_000)
    earned = found.metrics().discounted_return
    assert 0.5 < bound.start_value < earned.value + 4 * earned.standard_error
    assert earned.value > 0.6  # 0.632 is the best that was found, 0.41 what acting by the most likely state earns
    assert found.terminated.mean() > 0.99
    assert np.median(found.lengths) <= 28


def test_every_vector_is_below_what_a_policy_that_sees_the_state_earns(noisy_pomdp: TabularPOMDP) -> None:
    bound = point_based(noisy_pomdp)
    assert (bound.vectors <= value_iteration(noisy_pomdp).values + 1e-6).all()


def test_the_policy_earns_the_bound(noisy_pomdp: TabularPOMDP) -> None:
    bound = point_based(noisy_pomdp)
    earned = play(tabular_task(noisy_pomdp, 150), bound.agent(), 20_000).metrics().discounted_return
    assert abs(earned.value - bound.start_value) < 4 * earned.standard_error


def test_a_backup_is_the_best_of_all_plans_of_one_step_more(noisy_pomdp: TabularPOMDP) -> None:
    model = Model(noisy_pomdp, 0.9)
    blind = model.blind()
    beliefs = np.random.default_rng(0).dirichlet(np.ones(6), 20)
    vectors, actions = model.backed_up(blind, beliefs)
    for belief, vector, action in zip(beliefs, vectors, actions, strict=True):
        values = []
        for a in range(3):
            value = belief @ noisy_pomdp.expected_rewards()[:, a]
            arriving = (belief @ noisy_pomdp.transition_matrix(a))[:, None] * noisy_pomdp.observation_matrix(a)
            arriving[noisy_pomdp.terminal] = 0
            values.append(value + 0.9 * sum(max(blind.vectors @ joint) for joint in arriving.T))
        assert belief @ vector == pytest.approx(max(values))
        assert values[action] == pytest.approx(max(values))


def test_the_same_seed_gives_the_same_bound(noisy_pomdp: TabularPOMDP) -> None:
    one, other = (point_based(noisy_pomdp, rounds=2, seed=4) for _ in range(2))
    np.testing.assert_array_equal(one.vectors, other.vectors)
    np.testing.assert_array_equal(one.points, other.points)


def test_without_discount_it_is_refused() -> None:
    with pytest.raises(ValueError, match="must be below 1, got 1"):
        point_based(task("maze4x3").pomdp)
