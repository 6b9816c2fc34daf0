from __future__ import annotations

import numpy as np
import pytest

from dpsearch.env_kit.stepper import LaneStepper
from dpsearch.kernels.philox import stream_key
from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.solvers.agents import BeliefAgent, Controller
from dpsearch.pomdp.solvers.play import ABREAST, Played, play
from dpsearch.pomdp.task import tabular_task
from tests.support.optima import task

NAMES = ("returns", "discounted", "lengths", "terminated")


def assert_equal(one: Played, other: Played) -> None:
    for name in NAMES:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def wary(pomdp: TabularPOMDP) -> BeliefAgent:
    """An agent whose actions depend on all that it saw."""
    return BeliefAgent(pomdp, lambda beliefs: (beliefs @ pomdp.expected_rewards()).argmin(axis=1))


def test_episodes_are_those_of_one_environment_after_the_other(noisy_pomdp: TabularPOMDP) -> None:
    """A slow twin: a single environment, and the sums written out."""
    agent, played = wary(noisy_pomdp), tabular_task(noisy_pomdp, 12)
    found = play(played, agent, 60, seed=5)
    for episode in range(60):
        stepper = LaneStepper(played.kernel, 1)
        stepper.set_key(0, stream_key(5, episode))
        stepper.reset(np.ones(1, np.bool_))
        memory = agent.start(stepper.state()[:, 1].astype(int))
        rewards: list[float] = []
        terminated = False
        while not terminated and len(rewards) < 12:
            actions = agent.choose(memory, np.zeros(1))
            reward, over = stepper.step(actions)
            rewards.append(float(reward[0]))
            terminated = bool(over[0])
            if not terminated:
                memory = agent.update(memory, actions, stepper.state()[:, 1].astype(int))
        assert found.returns[episode] == pytest.approx(sum(rewards), abs=1e-12)
        assert found.discounted[episode] == pytest.approx(sum(r * 0.9**t for t, r in enumerate(rewards)), abs=1e-12)
        assert found.lengths[episode] == len(rewards)
        assert found.terminated[episode] == terminated
    assert found.terminated.any()
    assert not found.terminated.all()


def test_the_same_seed_gives_the_same_episodes_and_another_one_others(noisy_pomdp: TabularPOMDP) -> None:
    played, agent = tabular_task(noisy_pomdp, 12), Controller.random(noisy_pomdp)
    assert_equal(play(played, agent, 500, seed=1), play(played, agent, 500, seed=1))
    other = play(played, agent, 500, seed=2)
    assert (play(played, agent, 500, seed=1).returns != other.returns).mean() > 0.9


def test_an_episode_does_not_depend_on_how_many_are_played(noisy_pomdp: TabularPOMDP) -> None:
    played, agent = tabular_task(noisy_pomdp, 12), wary(noisy_pomdp)
    many, few = play(played, agent, ABREAST + 100), play(played, agent, 100)
    assert_equal(few, Played(*(getattr(many, name)[:100] for name in NAMES)))
    assert len(many.returns) == ABREAST + 100
    assert (many.returns[ABREAST:] != many.returns[:100]).mean() > 0.9


def test_the_step_cap_is_the_tasks() -> None:
    played = task("tiger")
    found = play(played, Controller.memoryless(np.eye(3)[[0, 0, 0]]), 10)
    assert (found.returns == -100).all()
    assert (found.lengths == 100).all()
    assert not found.terminated.any()
    assert found.metrics().reward_per_step.value == -1


def test_no_episodes_cannot_be_played(noisy_pomdp: TabularPOMDP) -> None:
    with pytest.raises(ValueError, match="episodes must be at least 1, got 0"):
        play(tabular_task(noisy_pomdp, 12), Controller.random(noisy_pomdp), 0)
