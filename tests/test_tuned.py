"""Settings that an algorithm has for an environment (configs/tuned) learn what they are for."""

from __future__ import annotations

from dataclasses import asdict

import pytest

from scripts.experiments.training import compose


@pytest.mark.parametrize(("core", "learns"), [("lstm", True), ("none", False)])
def test_a_pole_whose_velocities_are_hidden_is_balanced_by_who_remembers(core: str, learns: bool) -> None:
    hidden = ("algo=rpg", "env=gym", "env.id=CartPole-v1", "env.observe_only=[0,2]")
    settings = compose((*hidden, f"policy.core={core}"))
    algorithm = settings.algorithm(settings.rollouts(), seed=1)
    algorithm.learn(total_episodes=400)
    assert (algorithm.evaluate(30).mean_return > 150.0) == learns  # without memory 2 million steps come to 55


@pytest.mark.parametrize("name", ["pomdps_rpg", "pomdps_rpg_thesis", "tmaze_fast", "maze89_best", "maze89_thesis"])
def test_an_experiment_has_its_own_settings_in_any_environment(name: str) -> None:
    own, elsewhere = (
        asdict(compose((f"experiment={name}", *env)).config.algo) for env in ((), ("env=gym", "env.id=CartPole-v1"))
    )
    assert {**own, "gamma": elsewhere["gamma"]} == elsewhere
