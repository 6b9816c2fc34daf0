"""Runs in the 89-state maze, and the agents that do not learn."""

from __future__ import annotations

import pytest

from dpsearch.algos import RPG
from dpsearch.policies import PolicyConfig
from scripts.experiments.maze89.runs import measure
from scripts.experiments.maze89.tables import LEARNED

SHORT = ("total_steps=20_000",)


@pytest.mark.parametrize(
    ("name", "goal", "median"), [("random", 21.7, 252), ("hand", 100.0, 48), ("sighted", 100.0, 12)]
)
def test_yardsticks_achieve_what_was_computed_elsewhere(name: str, goal: float, median: float) -> None:
    found = measure((name,), 0)
    assert found["sampled_goal"] == pytest.approx(goal, abs=1.0)
    assert found["sampled_median"] == pytest.approx(median, abs=1.0)


def test_a_run_says_what_its_sampled_and_its_greedy_policy_achieve() -> None:
    found = measure((*LEARNED["rpg_thesis"].overrides, *SHORT), 1)
    assert found["env_steps"] >= 20_000
    for kind in ("sampled", "greedy"):
        assert 0.0 <= found[f"{kind}_goal"] < 60.0
        assert found[f"{kind}_quantile_90"] == 252


def test_with_a_history_baseline_the_maze_is_learned() -> None:
    rpg = RPG(
        "dpsearch/Maze89-v0",
        policy=PolicyConfig(init_range=0.1, previous_action=True),
        batch_size=20,
        optimizer="Adam",
        learning_rate=0.01,
        gradient_length=None,
        baseline="history",
        trace=0.8,
        normalise_advantages=True,
        entropy_bonus=0.1,
        entropy_halflife=1500,
    )
    rpg.learn(total_steps=3_000_000)
    assert rpg.evaluate(500).mean_return > 0.65  # at random 0.22, and with a constant baseline about 0.45 by now
