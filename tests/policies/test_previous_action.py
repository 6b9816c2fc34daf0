"""A policy that sees its previous action, against the wrapper that appends it to what the environment shows."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

from dpsearch.algos import RPG
from dpsearch.env_kit import PreviousAction
from dpsearch.policies import CORES, PolicyConfig, PolicyRunner, RecurrentPolicy
from dpsearch.rollout import make_rollouts

MAZE = "dpsearch.envs:dpsearch/Maze4x3-v0"
POLES = "dpsearch.envs:dpsearch/DoublePoleHidden-v0"


def policies(env: str, core: str, **options: Any) -> tuple[RecurrentPolicy, RecurrentPolicy]:
    """One that sees its previous action, and one of the same weights for the environment that shows it."""
    plain = gym.make(env)
    config = PolicyConfig(core=core, hidden_size=5, init_range=1.0)
    echoing = replace(config, previous_action=True)
    echo = RecurrentPolicy.for_spaces(plain.observation_space, plain.action_space, echoing, **options)
    shown = PreviousAction(plain)
    twin = RecurrentPolicy.for_spaces(shown.observation_space, plain.action_space, config, **options)
    twin.load_vector(echo.vector())
    return echo, twin


@pytest.mark.parametrize("core", list(CORES))
@pytest.mark.parametrize(("env", "options"), [(MAZE, {}), (POLES, {}), (POLES, {"deterministic": True})])
@pytest.mark.parametrize("greedy", [False, True])
def test_it_plays_as_if_the_environment_showed_the_action(
    core: str, env: str, options: dict[str, Any], greedy: bool
) -> None:
    echo, twin = policies(env, core, **options)
    ours = make_rollouts(env, max_episode_steps=40).collect(echo, 30, key=5, greedy=greedy)
    shown = torch.from_numpy(ours.observations)
    actions = torch.from_numpy(ours.actions)
    previous = torch.cat((torch.zeros_like(echo.head.echo(actions[:1])), echo.head.echo(actions[:-1])))
    with torch.no_grad():
        by_echo = echo(shown, actions=actions)[0]
        by_twin = twin(torch.cat((shown, previous.float()), -1))[0]
    torch.testing.assert_close(by_echo, by_twin)
    if greedy:
        chosen = echo.head.mode(by_echo).numpy()
        played = ours.mask
        np.testing.assert_allclose(chosen[played], ours.actions[played], atol=1e-4)


@pytest.mark.parametrize("core", list(CORES))
def test_both_engines_play_alike(core: str) -> None:
    echo, _ = policies(POLES, core)
    lanes = make_rollouts(POLES, max_episode_steps=30).collect(echo, 40, key=9, greedy=True)
    wrapped = make_rollouts(lambda: gym.wrappers.TransformReward(gym.make(POLES), float), max_episode_steps=30)
    other = wrapped.collect(echo, 40, key=9, greedy=True)  # starts are always the same, nothing else is random
    np.testing.assert_array_equal(lanes.lengths, other.lengths)
    np.testing.assert_allclose(lanes.actions, other.actions, rtol=1e-5, atol=1e-6)


def test_candidates_of_a_population_see_their_own_actions() -> None:
    echo, _ = policies(MAZE, "lstm")
    rollouts = make_rollouts(MAZE)
    population = np.random.default_rng(0).normal(size=(6, len(echo.vector()))).astype(np.float32).astype(float)
    returns, _ = rollouts.evaluate(echo, population, key=2, episodes=[[3, 4]] * 6)
    for weights, row in zip(
        population, returns, strict=True
    ):  # one by one in single precision: no return depends on it
        echo.load_vector(weights)
        np.testing.assert_array_equal(rollouts.collect(echo, 2, key=2, first_episode=3).returns, row)


def test_step_by_step_is_as_all_at_once() -> None:
    echo, _ = policies(MAZE, "lstm")
    episodes = make_rollouts(MAZE).collect(echo, 8, key=1)
    observations, actions = torch.from_numpy(episodes.observations), torch.from_numpy(episodes.actions)
    with torch.no_grad():
        whole, after = echo(observations, actions=actions)
        state = torch.zeros(8, echo.state_size)
        for t in range(len(observations)):
            step, state = echo(observations[t : t + 1], state, actions[t : t + 1])
            torch.testing.assert_close(step[0], whole[t])
    torch.testing.assert_close(state, after)


def test_a_runner_and_predict_remember_the_action_and_forget_it_when_an_episode_begins() -> None:
    echo, _ = policies(MAZE, "lstm")
    runner = PolicyRunner(echo, 2, greedy=True)
    observation = np.zeros((2, echo.observation_size))
    actions = runner.act(observation)
    np.testing.assert_array_equal(runner.state[:, -4:], np.eye(4)[actions[:, 0]])
    runner.reset([True, False])
    assert not runner.state[0].any()
    assert runner.state[1].any()
    algorithm = RPG(MAZE, policy=echo)
    action, state = algorithm.predict(observation[0], deterministic=True)
    np.testing.assert_array_equal(state[0, -4:], np.eye(4)[action])


def test_whole_episodes_need_their_actions() -> None:
    echo, _ = policies(MAZE, "lstm")
    with pytest.raises(ValueError, match="needs the actions"):
        echo(torch.zeros(3, 2, echo.observation_size))
