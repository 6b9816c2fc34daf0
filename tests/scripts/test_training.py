from typing import Any

import numpy as np
import pytest

from dpsearch.algos import RPG
from dpsearch.policies import RecurrentPolicy
from dpsearch.rollout import Episodes, Rollouts, make_rollouts
from scripts.experiments.training import GoalCounter, compose, until_goals, until_solved

TINY = ("algo=rpg", "env=tmaze", "env.corridor_length=1")


def test_the_settings_are_those_of_the_configuration_files() -> None:
    settings = compose((*TINY, "policy.core=elman", "algo.batch_size=7"))
    assert settings.algo == "rpg"
    assert settings.network == "Elman, 10 units"
    algorithm = settings.algorithm(settings.rollouts(), seed=5)
    assert isinstance(algorithm, RPG)
    assert (algorithm.config.batch_size, algorithm.seed, algorithm.policy.config()["core"]) == (7, 5, "elman")


def test_a_fingerprint_tells_settings_apart_but_not_where_the_run_is_kept() -> None:
    first = compose(TINY).fingerprint()
    assert compose((*TINY, "seed=3", "run_dir=elsewhere", "progress=false")).fingerprint() == first
    others = ("algo.batch_size=7", "policy.core=elman", "env.encoding=one_hot", "total_steps=9")
    assert len({first, *(compose((*TINY, other)).fingerprint() for other in others)}) == 5


def test_runs_that_were_logged_before_a_setting_existed_are_found() -> None:
    long = ("algo=rpg", "env=tmaze", "env.corridor_length=10", "total_steps=20000000")
    assert compose(long).fingerprint() == "7b1cb480862f55aa"
    assert (
        compose(
            (
                *long,
                "policy.readout=false",
            )
        ).fingerprint()
        != compose(long).fingerprint()
    )


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
