import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from dpsearch.policies import RecurrentPolicy
from dpsearch.rollout import Episodes, Rollouts, make_rollouts
from scripts.experiments.learning import GoalCounter, learn, until_goals, until_solved
from scripts.experiments.training import compose
from tests.support.application import ROOT

TINY = ("algo=rpg", "env=tmaze", "env.corridor_length=1")


def test_a_run_ends_when_it_has_solved_the_task() -> None:
    outcome = until_solved(TINY, 0)
    assert outcome["solved"] == 1
    assert outcome["episodes"] == 20 * outcome["updates"]
    assert outcome["env_steps"] >= 2 * outcome["episodes"]
    assert outcome["core_seconds"] > 0.0


@pytest.mark.parametrize("run", [until_solved, until_goals])
def test_a_run_fails_at_its_limit(run: Any) -> None:
    outcome = run((*TINY, "total_steps=1000"), 0)
    assert outcome["solved"] == 0
    assert outcome["env_steps"] >= 1000


def test_the_same_seed_gives_the_same_outcome() -> None:
    first, second = (until_goals(TINY, 1) for _ in range(2))
    assert {**first, "core_seconds": 0} == {**second, "core_seconds": 0}
    assert first["solved"] == 1


class Script(Rollouts):
    """Rollouts whose episodes end as a script says: with a final reward each."""

    def __init__(self, finals: list[float], terminated: bool = True) -> None:
        vars(self).update(vars(make_rollouts("dpsearch.envs:dpsearch/TMaze-v0")))
        self._finals, self._terminated = iter(finals), terminated

    def play(self, policy: Any, weights: Any, key: Any, numbers: Any, *others: Any, record: bool) -> Episodes:
        n_episodes = len(numbers)
        lengths = np.arange(1, n_episodes + 1)
        rewards = np.full((n_episodes, n_episodes), 9.0, np.float32)
        finals = [next(self._finals) for _ in range(n_episodes)]
        rewards[lengths - 1, np.arange(n_episodes)] = finals
        empty = np.zeros((n_episodes, n_episodes, 1), np.float32)
        return Episodes(empty, empty, rewards, lengths, np.full(n_episodes, self._terminated), np.array(finals))

    def close(self) -> None:
        pass


def counter(finals: list[float], terminated: bool = True) -> tuple[GoalCounter, RecurrentPolicy]:
    rollouts = Script(finals, terminated)
    return GoalCounter(rollouts), RecurrentPolicy.for_spaces(rollouts.observation_space, rollouts.action_space)


@pytest.mark.parametrize(("goals", "succeeds"), [(95, True), (94, False)])
def test_95_of_the_last_100_training_episodes_have_to_end_at_the_goal(goals: int, succeeds: bool) -> None:
    finals = [-0.1] * 50 + [4.0] * goals + [-0.1] * (100 - goals)
    rollouts, policy = counter(finals)
    for _ in range(15):
        assert not rollouts.succeeds
        rollouts.collect(policy, 10, key=0)
    assert rollouts.succeeds == succeeds


def test_evaluation_episodes_do_not_count() -> None:
    rollouts, policy = counter([4.0] * 100)
    rollouts.collect(policy, 100, key=0, record=False)
    assert not rollouts.succeeds


def test_episodes_that_the_step_cap_ended_did_not_reach_the_goal() -> None:
    rollouts, policy = counter([4.0] * 100, terminated=False)
    rollouts.collect(policy, 100, key=0)
    assert not rollouts.succeeds


def test_a_run_counts_what_was_played_and_takes_its_time() -> None:
    run = learn(compose((*TINY, "total_updates=3")), 0)
    counts = run.counts("updates", "episodes", "evaluations", "env_steps", "core_seconds")
    assert list(counts) == ["updates", "episodes", "evaluations", "env_steps", "core_seconds"]
    assert (counts["updates"], counts["episodes"], counts["evaluations"]) == (3, 60, 60)
    assert counts["env_steps"] >= 120
    assert counts["core_seconds"] > 0.0
    assert run.wall_seconds > 0.0


def test_a_callback_ends_a_run() -> None:
    run = learn(compose(TINY), 0, callback=lambda algorithm, metrics: algorithm.updates < 2)
    assert run.algorithm.updates == 2


@pytest.mark.parametrize("warm_up", [True, False])
def test_warming_up_changes_nothing_that_is_learned(warm_up: bool) -> None:
    settings = compose((*TINY, "total_updates=2"))
    algorithm = settings.algorithm(settings.rollouts(), 4)
    algorithm.learn(total_updates=2)
    run = learn(settings, 4, warm_up=warm_up)
    np.testing.assert_array_equal(run.algorithm.policy.vector(), algorithm.policy.vector())


def test_a_run_that_diverges_ends_as_it_is() -> None:
    def diverge(*_: object) -> bool:
        raise FloatingPointError

    run = learn(compose(TINY), 0, callback=diverge)
    assert run.algorithm.updates == 1


@pytest.mark.parametrize("algo", ["rpg", "xnes"])
def test_no_code_is_compiled_or_loaded_under_the_watch(algo: str) -> None:
    code = f"""
from scripts.experiments import learning
from scripts.experiments.training import compose
from dpsearch.policies import CORES
from dpsearch.policies.heads import categorical, softmax_gradient
from dpsearch.rollout import lane_loop

kernels = [core.step for core in CORES.values()]
kernels += [categorical.categorical_sample, softmax_gradient.softmax_gradient, lane_loop.play]
seen = []

def look():
    seen.append([len(kernel.signatures) for kernel in kernels])
    return 0.0

learning.process_time = look
learning.learn(compose(("algo={algo}", "env=tmaze", "env.corridor_length=1", "total_updates=2")), 0)
assert len(seen) == 2 and seen[0] == seen[1] and any(seen[0]), seen
"""
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)
