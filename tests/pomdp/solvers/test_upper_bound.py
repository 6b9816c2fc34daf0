import pytest

from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.solvers.point_based import point_based
from dpsearch.pomdp.solvers.upper_bound import upper_bound
from dpsearch.pomdp.solvers.value_iteration import value_iteration
from tests.support.optima import OPTIMAL, task


@pytest.mark.parametrize("name", OPTIMAL)
def test_the_bounds_meet_where_few_beliefs_are_possible(name: str) -> None:
    lower = point_based(task(name).pomdp)
    assert -1e-9 < upper_bound(lower) - lower.start_value < 1e-6


@pytest.mark.parametrize("name", ["maze4x3", "maze4x3, minus ends"])
def test_the_bounds_nearly_meet_in_the_4x3_maze(name: str) -> None:
    lower = point_based(task(name).pomdp, 0.9999, beliefs=80)
    assert 0 < upper_bound(lower) - lower.start_value < 1e-3


def test_the_optimum_lies_between_the_bounds_and_more_beliefs_bring_them_together(noisy_pomdp: TabularPOMDP) -> None:
    rough, fine = (point_based(noisy_pomdp, rounds=2, beliefs=beliefs) for beliefs in (3, 100))
    assert rough.start_value <= fine.start_value < upper_bound(fine)
    assert upper_bound(fine) - fine.start_value < 0.8 * (upper_bound(rough) - rough.start_value)
    assert upper_bound(rough) < value_iteration(noisy_pomdp).start_value
