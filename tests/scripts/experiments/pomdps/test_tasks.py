"""The tasks of tables 6.1 and 7.2, and what policies achieve there without learning."""

from __future__ import annotations

import pytest

from scripts.experiments.pomdps.tasks import TASKS, yardsticks

RANDOM = {
    "tiger_single": -36,
    "maze4x3_any_way": 0.056,
    "cheese_anywhere": 0.072,
    "tmaze3_either": 0.166,
    "tmaze5_either": 0.046,
}


@pytest.mark.parametrize("name", RANDOM)
def test_the_tasks_behind_the_thesis_s_numbers_have_its_random_policy_s(name: str) -> None:
    assert yardsticks(name).random.thesis_metric.value == pytest.approx(RANDOM[name], rel=0.04)


def test_the_optimal_policy_of_the_4x3_maze_has_the_thesis_s_numbers_of_those_by_hand_and_by_rpg() -> None:
    assert yardsticks("maze4x3_any_way").optimal.thesis_metric.value == pytest.approx(0.27, abs=0.005)
    assert yardsticks("maze4x3").optimal.thesis_metric.value == pytest.approx(0.21, abs=0.005)


@pytest.mark.parametrize("name", TASKS)
def test_written_by_hand_is_between_random_and_optimal(name: str) -> None:
    known = yardsticks(name)
    assert 0.9 < known.share(known.hand.discounted_return.value) < 1.01
