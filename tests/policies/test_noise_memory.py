"""A Gaussian policy whose noise lasts, against the joint distribution of an autoregressive process."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from dpsearch.algos import RPG
from dpsearch.kernels.lanes import LANES
from dpsearch.policies import CORES, Categorical, Gaussian, PolicyConfig, PolicyRunner, RecurrentPolicy
from dpsearch.rollout import Episodes, Stream, make_rollouts

POLES = "dpsearch.envs:dpsearch/DoublePoleHidden-v0"
MEMORY = 0.8


def policy(core: str = "lstm", memory: float = MEMORY, **options: Any) -> RecurrentPolicy:
    env = gym.make(POLES)
    config = PolicyConfig(core=core, hidden_size=4, init_range=0.5, noise_memory=memory, **options)
    return RecurrentPolicy.for_spaces(env.observation_space, env.action_space, config, seed=3)


def played(network: RecurrentPolicy, n: int = 30, **options: Any) -> Episodes:
    return make_rollouts(POLES, max_episode_steps=30).collect(network, n, key=5, **options)


def noise_in(network: RecurrentPolicy, episodes: Episodes) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How far each action is from the mean that the network alone would give, and sigma, both ``(T, N)``."""
    observations, actions = torch.from_numpy(episodes.observations), torch.from_numpy(episodes.actions)
    with torch.no_grad():
        outputs = network.readout(network.unroll(observations, actions, episodes.lengths)).double()
    return actions[..., 0].numpy() - outputs[..., 0].numpy(), torch.sigmoid(outputs[..., 1]).numpy()


@pytest.mark.parametrize("core", list(CORES))
def test_log_probabilities_are_those_of_the_joint_distribution(core: str) -> None:
    network = policy(core, previous_action=core == "lstm")
    episodes = played(network)
    observations, actions = torch.from_numpy(episodes.observations), torch.from_numpy(episodes.actions)
    with torch.no_grad():
        outputs, _ = network(observations, actions=actions)
        log_prob = network.head.log_prob(outputs, actions).double().numpy()
    noise, std = noise_in(network, episodes)
    for n in range(5):
        steps = int(episodes.lengths[n])
        lasting = np.tril(MEMORY ** np.abs(np.subtract.outer(np.arange(steps), np.arange(steps))))
        covariance = lasting @ np.diag(std[:steps, n] ** 2) @ lasting.T
        expected = multivariate_normal(cov=covariance).logpdf(noise[:steps, n])
        assert log_prob[:steps, n].sum() == pytest.approx(expected, rel=1e-4, abs=1e-3)


@pytest.mark.parametrize("core", list(CORES))
def test_the_noise_played_is_autoregressive(core: str) -> None:
    network = policy(core, previous_action=True, init_std=0.1)
    episodes = played(network, n=4_000)
    (noise, std), both = noise_in(network, episodes), episodes.mask[1:]
    before, after = noise[:-1][both], noise[1:][both]
    assert before @ after / (before @ before) == pytest.approx(MEMORY, abs=0.01)
    fresh = (after - MEMORY * before) / std[1:][both]
    assert abs(np.corrcoef(before, fresh)[0, 1]) < 0.02
    assert fresh.std() == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("core", list(CORES))
def test_both_engines_play_alike(core: str) -> None:
    network = policy(core, previous_action=True)
    other = make_rollouts(lambda: gym.wrappers.TransformReward(gym.make(POLES), float), max_episode_steps=30)
    lanes, vectors = played(network, n=LANES + 3), other.collect(network, LANES + 3, key=5)
    np.testing.assert_array_equal(lanes.lengths, vectors.lengths)
    np.testing.assert_allclose(lanes.actions, vectors.actions, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("core", list(CORES))
def test_without_sampling_there_is_no_noise(core: str) -> None:
    with_noise, without = policy(core), policy(core, 0.0)
    without.load_vector(with_noise.vector())
    np.testing.assert_array_equal(played(with_noise, greedy=True).actions, played(without, greedy=True).actions)


def test_candidates_of_a_population_have_noise_of_their_own() -> None:
    network = policy()
    rollouts = make_rollouts(POLES, max_episode_steps=30)
    population = np.random.default_rng(0).normal(size=(6, len(network.vector()))).astype(np.float32).astype(float)
    returns, _ = rollouts.evaluate(network, population, key=2, episodes=[[3, 4]] * 6)
    for weights, row in zip(
        population, returns, strict=True
    ):  # one by one in single precision: no return depends on it
        network.load_vector(weights)
        np.testing.assert_array_equal(rollouts.collect(network, 2, key=2, first_episode=3).returns, row)


@pytest.mark.parametrize("previous_action", [False, True])
def test_step_by_step_is_as_all_at_once(previous_action: bool) -> None:
    network = policy(previous_action=previous_action)
    episodes = played(network, n=8)
    steps = int(episodes.lengths.min())
    observations, actions = torch.from_numpy(episodes.observations[:steps]), torch.from_numpy(episodes.actions[:steps])
    with torch.no_grad():
        whole, after = network(observations, actions=actions)
        state = torch.zeros(8, network.state_size)
        for t in range(steps):
            step, state = network(observations[t : t + 1], state, actions[t : t + 1])
            torch.testing.assert_close(step[0], whole[t])
    torch.testing.assert_close(state, after)


def test_a_runner_remembers_its_noise_and_forgets_it_when_an_episode_begins() -> None:
    network = policy()
    runner = PolicyRunner(network, 2, seed=1)
    observation = np.zeros((2, network.observation_size))
    actions = runner.act(observation)
    with torch.no_grad():
        mean = network.readout(network.remember(torch.zeros(1, 2, network.observation_size))[0])[0, :, :1]
    np.testing.assert_allclose(runner.state[:, -1:], torch.from_numpy(actions).float() - mean, atol=1e-6)
    runner.reset([True, False])
    assert not runner.state[0].any()
    assert runner.state[1, -1] != 0.0


def test_a_stream_in_pieces_is_played_as_one() -> None:
    def actions(update_steps: int, updates: int) -> NDArray[np.float32]:
        config = PolicyConfig(hidden_size=3, init_range=0.3, noise_memory=MEMORY)
        rpg = RPG(POLES, policy=config)
        stream = Stream(rpg.rollouts, rpg.training_key)
        pieces = [stream.play(rpg.policy, update_steps) for _ in range(updates)]
        return np.concatenate([p.actions[:, n][p.mask[:, n]] for p in pieces for n in range(len(p))])

    np.testing.assert_array_equal(actions(40, 3), actions(120, 1))


@pytest.mark.parametrize("memory", [-0.1, 1.0, float("nan")])
def test_a_memory_that_is_no_part_is_refused(memory: float) -> None:
    with pytest.raises(ValueError, match="noise_memory must be at least 0 and below 1"):
        RecurrentPolicy(3, Gaussian(1), PolicyConfig(noise_memory=memory))


def test_noise_is_gaussian() -> None:
    with pytest.raises(ValueError, match="noise_memory must be 0"):
        RecurrentPolicy(3, Categorical([2]), PolicyConfig(noise_memory=0.5))


def test_whole_episodes_need_their_actions() -> None:
    with pytest.raises(ValueError, match="needs the actions"):
        policy()(torch.zeros(3, 2, 3))
