"""Runs on small POMDPs, and how their policies are judged."""

from __future__ import annotations

import pytest

from dpsearch.algos import RPG
from dpsearch.policies import PolicyConfig
from scripts.experiments.pomdps.runs import judged, learn_and_play
from scripts.experiments.pomdps.tables import METHODS, cell
from scripts.experiments.pomdps.tasks import TASKS, yardsticks


def test_a_policy_is_judged_by_all_metrics() -> None:
    algorithm = RPG("dpsearch/Tiger-v0", policy=PolicyConfig(init_range=0.0))  # all actions equally likely
    known = yardsticks("tiger").random
    found = judged(algorithm, 0.75, 1000, greedy=False)
    for metric in ("episode_return", "reward_per_step", "thesis_metric", "discounted_return"):
        estimate = getattr(found, metric)
        assert abs(estimate.value - getattr(known, metric).value) < 4 * estimate.standard_error


def test_a_run_says_how_far_both_of_its_policies_got() -> None:
    task = TASKS["maze4x3"]
    outcome = learn_and_play(("maze4x3", cell(METHODS["cmaes"], task).recipe[1]), 0)  # type: ignore[index]
    assert 3000 <= outcome["episodes"] < 3100
    assert 0.3 < outcome["sampled_share"] < 1.02
    assert outcome["sampled_discounted_return"] > -1.0  # at random -1.96
    assert outcome["sampled_episode_return"] == pytest.approx(outcome["sampled_discounted_return"], abs=1e-5)  # gamma 1
