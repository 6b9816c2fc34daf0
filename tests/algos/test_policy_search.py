"""Policy search: what is asked of the engine, what solves, and that a run depends on config and seed alone."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from omegaconf import OmegaConf

from dpsearch.algos import ALGORITHMS, NESPolicySearch, PolicySearch, SNESPolicySearch, XNESPolicySearch
from dpsearch.envs import DoublePoleHidden
from dpsearch.policies import PolicyConfig, RecurrentPolicy
from dpsearch.rollout import Episodes, make_rollouts
from dpsearch.search import SEARCHES, Restarts
from dpsearch.search.fem import THESIS
from tests.support.toy_envs import Countdown

POLE = "dpsearch/SinglePole-v0"
SEARCHERS = sorted(SEARCHES)


def searcher(name: str, env: Any = POLE, **options: Any) -> PolicySearch:
    algorithm = ALGORITHMS[name](env, **options)
    assert isinstance(algorithm, PolicySearch)
    return algorithm


class Priceless(Countdown):
    """Pays NaN."""

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        observation, _, *rest = super().step(action)
        return observation, float("nan"), *rest


def test_every_search_has_its_algorithm() -> None:
    assert {name for name, kind in ALGORITHMS.items() if issubclass(kind, PolicySearch)} == set(SEARCHES)


@pytest.mark.parametrize("name", SEARCHERS)
def test_every_search_balances_a_pole(name: str) -> None:
    algorithm = searcher(name, seed=3).learn(until_solved=True, total_episodes=3000)
    assert algorithm.solved
    assert algorithm.evaluations == algorithm.search.best.evaluation <= algorithm.episodes
    assert algorithm.evaluate(2).mean_return == 100_000
    assert algorithm.search.best.x is not None
    np.testing.assert_allclose(algorithm.policy.vector(), algorithm.search.best.x, rtol=1e-6)


def test_two_poles_without_velocities_are_balanced_by_memory_and_not_without() -> None:
    hidden = "dpsearch/DoublePoleHidden-v0"
    for seed in range(3):
        assert searcher("xnes", hidden, seed=seed).learn(until_solved=True, total_episodes=3000).solved
        blind = searcher("xnes", hidden, seed=seed, policy=PolicyConfig(core="none", hidden_size=2, bias=False))
        assert not blind.learn(until_solved=True, total_episodes=3000).solved


@pytest.mark.parametrize("seed", [2, 3])
def test_a_candidate_is_judged_with_the_weights_that_its_policy_will_have(seed: int) -> None:
    algorithm = searcher("fem", "dpsearch/DoublePole-v0", seed=seed)  # seeds with which rounding them made poles fall
    algorithm.learn(total_episodes=3000, callback=lambda search, metrics: metrics["best"] < 100_000)
    assert algorithm.search.best.fitness == 100_000
    assert algorithm.evaluate(1).mean_return == 100_000


def test_one_recurrent_unit_without_a_readout_has_four_weights_and_suffices() -> None:
    unit = PolicyConfig(core="elman", hidden_size=1, bias=False, readout=False)
    algorithm = XNESPolicySearch(
        "dpsearch/DoublePoleHidden-v0", policy=unit, importance_mixing=True, population=12, sigma_learning_rate=0.2
    )
    assert len(algorithm.policy.vector()) == 4
    assert algorithm.learn(until_solved=True, total_episodes=2000).solved


def test_the_thesis_network_for_two_hidden_poles_has_42_weights() -> None:
    assert len(searcher("nes", "dpsearch/DoublePoleHidden-v0").policy.vector()) == 42


@pytest.mark.parametrize("common", [True, False])
def test_candidates_play_the_same_episodes_if_asked(common: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    rollouts = make_rollouts("dpsearch/TMaze-v0", env_kwargs={"corridor_length": 3})
    evaluate, calls = rollouts.evaluate, list[NDArray[np.int64]]()

    def recorded(*args: Any, episodes: Any, **options: Any) -> Any:
        calls.append(np.array(episodes))
        return evaluate(*args, episodes=episodes, **options)

    monkeypatch.setattr(rollouts, "evaluate", recorded)
    algorithm = SNESPolicySearch(rollouts, population=5, episodes_per_fitness=4, common_random_numbers=common)
    algorithm.learn(total_updates=2)
    assert [call.shape for call in calls] == [(5, 4), (5, 4)]
    assert all((call == call[0]).all() == common for call in calls)
    assert len(np.unique(calls)) == (8 if common else 40)
    assert algorithm.episodes == 40
    assert algorithm.evaluations == 10


def test_the_fitness_is_the_mean_return() -> None:
    algorithm = searcher("snes", "dpsearch/TMaze-v0", episodes_per_fitness=3, population=6, seed=2)
    algorithm.update()
    best = algorithm.search.best
    returns, _ = algorithm.rollouts.evaluate(
        algorithm.policy, best.x[None] if best.x is not None else [], key=algorithm.training_key, episodes=[[0, 1, 2]]
    )
    assert best.fitness == returns.mean()


def test_greedy_candidates_of_a_deterministic_task_always_earn_the_same() -> None:
    env = make_rollouts("dpsearch/TMaze-v0", env_kwargs={"corridor_length": 2})
    algorithm = SNESPolicySearch(env, greedy=True, episodes_per_fitness=8, seed=1, sigma0=3.0)
    algorithm.learn(total_updates=40)
    assert algorithm.search.best.fitness > 1.9


def test_a_fitness_that_tells_nothing_apart_is_said_to() -> None:
    flat = searcher("xnes", env_kwargs={"reward": "failure"})
    with pytest.warns(UserWarning, match="policies all have the same fitness, -1: the search has nothing"):
        flat.learn(total_episodes=150)


def test_the_mean_of_the_search_can_be_the_policy() -> None:
    algorithm = searcher("snes", "dpsearch/TMaze-v0", choice="mean").learn(total_updates=3)
    np.testing.assert_allclose(algorithm.policy.vector(), algorithm.search.mean, rtol=1e-6)
    assert not algorithm.check_solved()


def test_where_chance_plays_a_part_the_mean_is_the_policy_unless_asked_otherwise() -> None:
    algorithm = searcher("xnes", "dpsearch/TMaze-v0").learn(total_updates=3)
    np.testing.assert_allclose(algorithm.policy.vector(), algorithm.search.mean, rtol=1e-6)


def test_a_lucky_candidate_is_tested_once() -> None:
    algorithm = searcher("snes", "dpsearch/TMaze-v0", choice="best", seed=1)
    tested = []
    algorithm.learn(total_updates=60, until_solved=False)
    assert algorithm.search.best.fitness == 4.0
    for _ in range(3):
        before = algorithm._rejected
        algorithm.check_solved()
        tested.append(algorithm._rejected != before)
    assert tested == [True, False, False]


def test_the_experiment_as_in_the_thesis_has_its_settings() -> None:
    settings = OmegaConf.load(Path(__file__).parents[2] / "configs/experiment/poles_fem_thesis.yaml")
    assert {name: settings.algo[name] for name in THESIS} == THESIS


@pytest.mark.parametrize("name", SEARCHERS)
def test_a_run_goes_on_from_its_checkpoint_bit_for_bit(name: str, tmp_path: Path) -> None:
    whole = searcher(name, seed=5).learn(total_updates=8)
    half = searcher(name, seed=5).learn(total_updates=4)
    half.save(tmp_path / "half.pt")
    resumed = type(half).load(tmp_path / "half.pt").learn(total_updates=8)
    assert resumed.state_dict()["recent_returns"] == whole.state_dict()["recent_returns"]
    assert resumed.search.best.evaluation == whole.search.best.evaluation
    np.testing.assert_array_equal(resumed.search.ask(), whole.search.ask())
    np.testing.assert_array_equal(resumed.policy.vector(), whole.policy.vector())


def test_a_run_does_not_depend_on_the_number_of_threads() -> None:
    one, two = (
        searcher("nes", "dpsearch/DoublePoleHidden-v0", seed=1, threads=threads, population=60).learn(total_updates=5)
        for threads in (1, 2)
    )
    np.testing.assert_array_equal(one.search.ask(), two.search.ask())
    assert list(one.recent_returns) == list(two.recent_returns)


def test_any_gymnasium_environment_can_be_searched() -> None:
    algorithm = searcher("xnes", "CartPole-v1", seed=0, greedy=True)
    algorithm.learn(total_updates=15)
    assert algorithm.search.best.fitness > 150


def test_a_search_that_is_stuck_begins_again_or_ends() -> None:
    again = searcher("xnes", "dpsearch/DoublePoleHidden-v0", seed=0, patience=30).learn(total_episodes=600)
    assert isinstance(again.search, Restarts)
    assert again.search.runs > 1
    once = searcher("xnes", "dpsearch/DoublePoleHidden-v0", seed=0, patience=30, restarts=False)
    once.learn(total_episodes=600)
    assert once.finished
    assert "patience" in once.search.stop()
    assert once.episodes < 600


def test_where_the_search_begins_is_drawn_if_asked() -> None:
    near = NESPolicySearch(POLE, seed=1)
    assert np.abs(near.search.mean).max() <= 0.01
    far = NESPolicySearch(POLE, start_std=1.0, seed=1)
    assert 0.5 < far.search.mean.std() < 1.5
    assert not np.array_equal(far.search.mean, NESPolicySearch(POLE, start_std=1.0, seed=2).search.mean)


def test_rewards_that_are_not_finite_are_ranked_worst() -> None:
    algorithm = SNESPolicySearch(Priceless, population=4, max_episode_steps=20)
    with pytest.warns(UserWarning, match="NaN or infinite fitness"):
        algorithm.update()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        algorithm.update()
    assert algorithm.search.invalid == 8
    assert algorithm.search.best.x is None


@pytest.mark.parametrize(
    "options",
    [{"sigma0": 0.0}, {"start_std": -1.0}, {"episodes_per_fitness": 0}, {"choice": "median"}, {"tolx": -1.0},
     {"population": 0}, {"patience": 0}, {"gradient": "steepest"}],
)  # fmt: skip
def test_a_setting_out_of_range_is_named(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(options))):
        NESPolicySearch(POLE, **options)


def test_the_625_starts_are_a_harder_test_than_the_usual_one() -> None:
    from dpsearch.report.generalisation import generalisation_test

    algorithm = XNESPolicySearch(DoublePoleHidden, seed=0).learn(until_solved=True, total_episodes=3000)
    assert algorithm.solved
    assert 0 < generalisation_test(algorithm.policy) < 625


def test_where_nothing_is_random_one_episode_says_it_all() -> None:
    search = XNESPolicySearch("dpsearch/DoublePole-v0", max_episode_steps=50)
    played: list[int] = []
    collect = search.rollouts.collect

    def counted(policy: RecurrentPolicy, n_episodes: int, **options: Any) -> Episodes:
        played.append(n_episodes)
        return collect(policy, n_episodes, **options)

    search.rollouts.collect = counted  # type: ignore[method-assign]
    evaluation = search.evaluate(7)
    assert (played, len(evaluation.returns), evaluation.standard_error) == ([1], 7, 0.0)
    assert not XNESPolicySearch(
        "dpsearch/DoublePole-v0", env_kwargs={"start_state": "generalisation"}
    ).nothing_is_random
    assert not XNESPolicySearch("dpsearch/TMaze-v0").nothing_is_random
