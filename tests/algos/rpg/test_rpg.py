"""RPG against closed forms, finite differences of an exact expected return, and tasks that need memory."""

from __future__ import annotations

import dataclasses
import itertools
from copy import deepcopy
from typing import Any
from unittest import mock

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from dpsearch.algos import RPG
from dpsearch.algos.baselines.base import Baseline, Counted
from dpsearch.algos.baselines.constant import ConstantBaseline
from dpsearch.envs.tmaze import TMaze
from dpsearch.policies import CORES, Deterministic, PolicyConfig, RecurrentPolicy
from dpsearch.rollout import Episodes, LaneEngine
from tests.support.algorithms import HORIZON, gradients, small_rpg


def histories() -> list[Episodes]:
    """Every history of the T-maze with corridor 1, each an episode of its own, played by the scalar environment."""
    env = TMaze(corridor_length=1, max_episode_steps=HORIZON)
    found: dict[tuple[int, tuple[int, ...]], Episodes] = {}
    seeds: dict[tuple[float, ...], int] = {}
    for seed in range(50):  # one seed for each road sign
        seeds.setdefault(tuple(env.reset(seed=seed)[0]), seed)
    assert len(seeds) == 2
    for seed, actions in itertools.product(seeds.values(), itertools.product(range(4), repeat=HORIZON)):
        observation, _ = env.reset(seed=seed)
        seen, rewards = [], []
        for action in actions:
            seen.append(observation)
            observation, reward, terminated, truncated, _ = env.step(action)
            rewards.append(reward)
            if terminated or truncated:
                break
        length = len(rewards)
        found[seed, actions[:length]] = Episodes(
            observations=np.array(seen, np.float32)[:, None],
            actions=np.array(actions[:length], np.float32)[:, None, None],
            rewards=np.array(rewards, np.float32)[:, None],
            lengths=np.array([length]),
            terminated=np.array([terminated]),
            returns=np.array([float(np.sum(rewards))]),
        )
    return list(found.values())


def probabilities(policy: RecurrentPolicy, episodes: list[Episodes]) -> torch.Tensor:
    """p(H) of each history under a float64 policy; the two road signs are equally likely."""
    observations = np.zeros((HORIZON, len(episodes), 3))
    actions = np.zeros((HORIZON, len(episodes), 1))
    mask = np.zeros((HORIZON, len(episodes)))
    for i, e in enumerate(episodes):
        length = e.lengths[0]
        observations[:length, i], actions[:length, i], mask[:length, i] = (
            e.observations[:, 0],
            e.actions[:, 0],
            1.0,
        )
    outputs, _ = policy(torch.from_numpy(observations))
    log_p = policy.head.log_prob(outputs, torch.from_numpy(actions)) * torch.from_numpy(mask)
    return log_p.sum(0).exp() / 2


def exact_expected_return(policy: RecurrentPolicy, vector: NDArray[np.float64], episodes: list[Episodes]) -> float:
    policy.load_vector(vector)
    with torch.no_grad():
        return float(probabilities(policy, episodes) @ torch.tensor([e.returns[0] for e in episodes]))


class Fixed(Baseline):
    """b is a given number."""

    def __init__(self, value: float) -> None:
        self.value = value

    def __call__(
        self, episodes: Episodes, features: Tensor, returns: NDArray[np.float32], counted: Counted = None
    ) -> tuple[float, None]:
        return self.value, None

    def expected(self, episodes: Episodes, features: Tensor) -> float:
        return self.value

    def state_dict(self) -> dict[str, Any]:
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        pass


def gradient_of(rpg: RPG, episodes: Episodes, baseline: float = 0.0) -> NDArray[np.float64]:
    rpg.baseline = Fixed(baseline)
    rpg.optimizer.zero_grad()
    rpg.backpropagate(episodes)
    return -gradients(rpg)


@pytest.mark.parametrize("baseline", [0.0, 1.7])
def test_the_expected_gradient_is_that_of_the_exact_expected_return(baseline: float) -> None:
    rpg, episodes = small_rpg(), histories()
    start = rpg.policy.vector()
    exact = small_rpg().policy.double()
    chances = probabilities(exact, episodes).detach().numpy()
    assert chances.sum() == pytest.approx(1.0, abs=1e-6)
    expected = sum(p * gradient_of(rpg, e, baseline) for p, e in zip(chances, episodes, strict=True))
    step = 1e-5
    differences = np.empty_like(start)
    for i in range(len(start)):
        moved = start.copy()
        moved[i] += step
        up = exact_expected_return(exact, moved, episodes)
        moved[i] -= 2 * step
        differences[i] = (up - exact_expected_return(exact, moved, episodes)) / (2 * step)
    np.testing.assert_allclose(expected, differences, rtol=1e-4, atol=2e-6)


def test_sampled_gradients_average_to_the_exact_one() -> None:
    rpg, episodes = small_rpg(batch_size=500), histories()
    exact = small_rpg().policy.double()
    chances = probabilities(exact, episodes).detach().numpy()
    expected = sum(p * gradient_of(rpg, e) for p, e in zip(chances, episodes, strict=True))
    samples = np.array([gradient_of(rpg, rpg.play_batch(500)) for _ in range(100)])
    error = samples.std(0, ddof=1) / np.sqrt(len(samples))
    deviations = (samples.mean(0) - expected) / np.maximum(error, 1e-9)
    assert np.abs(deviations).max() < 5.0
    assert np.sqrt(np.mean(deviations**2)) == pytest.approx(1.0, abs=0.5)


def test_output_eligibilities_of_a_softmax_are_action_minus_probability() -> None:
    rpg = small_rpg()
    episodes = rpg.play_batch(6)
    returns = episodes.returns_to_go(1.0)
    automatic = gradient_of(rpg, episodes)
    outputs, _ = rpg.policy(torch.from_numpy(episodes.observations))
    chosen = torch.nn.functional.one_hot(torch.from_numpy(episodes.actions[..., 0]).long(), 4)
    eligibilities = (chosen - torch.softmax(outputs, -1)) * torch.from_numpy(returns * episodes.mask)[..., None] / 6
    rpg.optimizer.zero_grad()
    outputs.backward(eligibilities.detach())  # section 3.4.2: a_i - p_i, backpropagated through time
    by_hand = gradients(rpg)
    np.testing.assert_allclose(automatic, by_hand, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("variance_scaled", [False, True])
def test_output_eligibilities_of_a_gaussian_are_those_of_section_3_4_1(variance_scaled: bool) -> None:
    rpg = RPG("Pendulum-v1", batch_size=2, variance_scaled=variance_scaled, policy=PolicyConfig(init_range=0.3))
    episodes = rpg.play_batch(2)
    weights = episodes.returns_to_go(rpg.config.gamma)
    automatic = gradient_of(rpg, episodes)
    outputs, _ = rpg.policy(torch.from_numpy(episodes.observations))
    action, mean = torch.from_numpy(episodes.actions[..., 0]), outputs[..., 0].detach()
    sigma = torch.sigmoid(outputs[..., 1]).detach()
    of_mean = (action - mean) / sigma**2
    of_sigma = ((action - mean) ** 2 - sigma**2) / sigma**3
    eligibilities = torch.stack([of_mean, of_sigma * sigma * (1 - sigma)], -1)  # the sigmoid's own slope
    scale = sigma**2 if variance_scaled else torch.ones_like(sigma)
    rpg.optimizer.zero_grad()
    outputs.backward(eligibilities * (torch.from_numpy(weights) * scale)[..., None] / 2)
    by_hand = gradients(rpg)
    np.testing.assert_allclose(automatic, by_hand, rtol=2e-3, atol=1e-5)


def test_the_gradient_is_normalised_to_the_length_asked_for() -> None:
    rpg = small_rpg(gradient_length=0.3, learning_rate=1.0)
    before = rpg.policy.vector()
    rpg.update()
    assert np.linalg.norm(rpg.policy.vector() - before) == pytest.approx(0.3, rel=1e-4)


def test_a_batch_is_one_call_of_the_recurrent_core(monkeypatch: pytest.MonkeyPatch) -> None:
    rpg = small_rpg(batch_size=50)
    core = mock.Mock(wraps=torch.lstm)
    monkeypatch.setattr(torch, "lstm", core)
    rpg.update()
    assert core.call_count == 1


def padded(episodes: Episodes, steps: int) -> Episodes:
    def longer(array: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.concatenate([array, np.zeros((steps, *array.shape[1:]), np.float32)])

    return dataclasses.replace(
        episodes,
        observations=longer(episodes.observations),
        actions=longer(episodes.actions),
        rewards=longer(episodes.rewards),
    )


@pytest.mark.parametrize("baseline", ["constant", "shared", "history"])
@pytest.mark.parametrize("env", ["dpsearch/TMaze-v0", "Pendulum-v1"])
def test_padding_leaves_the_gradient_as_it_is(env: str, baseline: str) -> None:
    rpg = RPG(env, baseline=baseline, max_episode_steps=8, batch_size=5, policy=PolicyConfig(init_range=0.3))
    episodes = rpg.play_batch(5)
    if isinstance(rpg.baseline, ConstantBaseline):
        rpg.baseline.load_state_dict({"episodes": [[3.0, 2]]})  # b = 1.5, where padding would be seen
    found = []
    for batch in (episodes, padded(episodes, 7)):
        state = deepcopy(rpg.baseline.state_dict())
        rpg.optimizer.zero_grad()
        rpg.backpropagate(batch)
        found.append(gradients(rpg))
        rpg.baseline.load_state_dict(state)
    np.testing.assert_allclose(found[0], found[1], rtol=1e-4, atol=1e-5)


def test_a_vanishing_deviation_on_padding_makes_no_nan() -> None:
    rpg = RPG("Pendulum-v1", max_episode_steps=3, batch_size=2, variance_scaled=True)
    with torch.no_grad():
        rpg.policy.readout.bias[0], rpg.policy.readout.bias[1] = 0.7, -60.0
    rpg.rollouts.max_steps = 3
    episodes = padded(rpg.play_batch(2), 2)
    rpg.backpropagate(episodes)
    assert np.isfinite(gradients(rpg)).all()


def test_the_shared_baseline_learns_with_the_policy() -> None:
    rpg = small_rpg(baseline={"kind": "shared", "weight": 0.7}, batch_size=30)
    episodes = rpg.play_batch(30)
    rpg.optimizer.zero_grad()
    rpg.backpropagate(episodes)
    both = gradients(rpg)
    returns, mask = torch.from_numpy(episodes.returns_to_go(1.0)), torch.from_numpy(episodes.mask)
    features, _ = rpg.policy.remember(torch.from_numpy(episodes.observations))
    with torch.no_grad():
        expected, _ = rpg.baseline(episodes, features, returns.numpy(), mask.numpy())
    log_prob = rpg.policy.head.log_prob(rpg.policy.readout(features), torch.from_numpy(episodes.actions))
    regression = ((returns - rpg.baseline.parameters()[1]) * mask).square().sum()  # at first only its bias counts
    rpg.optimizer.zero_grad()
    ((-(log_prob * (returns - torch.as_tensor(expected)) * mask).sum() + 0.7 * regression) / 30).backward()
    by_hand = [p.grad for p in rpg.policy.free_parameters()]
    np.testing.assert_allclose(
        both[: sum(g.numel() for g in by_hand if g is not None)],
        np.concatenate([g.numpy().ravel() for g in by_hand if g is not None]),
        rtol=1e-4,
        atol=1e-5,
    )
    bias = rpg.baseline.parameters()[1].grad
    assert bias is not None
    assert both[-1] == pytest.approx(float(bias), rel=1e-4)


def test_batches_shrink_and_grow_to_a_number_of_steps() -> None:
    rpg = small_rpg(batch_size=2, batch_steps=100)
    counts: list[int] = []
    rpg.learn(total_updates=30, callback=lambda algorithm, _: counts.append(algorithm.episodes))
    assert all(100 / HORIZON * 0.8 <= size <= 100 for size in np.diff(counts))


@pytest.mark.parametrize("optimizer", ["SGD", "Adam", "RMSprop"])
def test_any_torch_optimiser_learns(optimizer: str) -> None:
    rpg = small_rpg(optimizer=optimizer, learning_rate=0.05, gradient_length=None)
    before = rpg.evaluate(200).mean_return
    rpg.learn(total_updates=150)
    assert rpg.evaluate(200).mean_return > before + 1.0


FADING: dict[str, Any] = {"entropy_bonus": 0.1, "entropy_halflife": 5.0, "learning_rate_halflife": 9.0}


@pytest.mark.parametrize(
    "settings",
    [
        {},
        {"baseline": "shared", "batch_steps": 150},
        {"normalise_advantages": True, "trace": 0.9, **FADING},
        {"baseline": "history"},
        {"baseline": "history", "restart_episodes": 40, "restart_gain": 100.0},
        {"baseline": "history", "natural_step": 0.01, "optimizer": "SGD", "gradient_length": None},
    ],
)
def test_state_goes_on_bit_for_bit(settings: dict[str, Any]) -> None:
    settings = {"optimizer": "Adam", "learning_rate": 0.01, **settings}
    one, other = small_rpg(**settings), small_rpg(**settings)
    one.learn(total_updates=20)
    other.learn(total_updates=7)
    resumed = small_rpg(**settings)
    resumed.load_state_dict(other.state_dict())
    resumed.learn(total_updates=20)
    np.testing.assert_array_equal(one.policy.vector(), resumed.policy.vector())
    assert list(one.recent_returns) == list(resumed.recent_returns)
    assert (resumed.starts > 1) == ("restart_episodes" in settings)


def test_it_begins_again_from_other_weights_when_a_start_gets_no_further() -> None:
    rpg = small_rpg(batch_size=10, restart_episodes=30, restart_gain=100.0, baseline="history", learning_rate=1e-9)
    found = []
    rpg.learn(total_episodes=180, callback=lambda rpg, _: found.append((rpg.starts, rpg.policy.vector())))
    assert [starts for starts, _ in found] == [1] * 6 + [2] * 6 + [3] * 6  # 30 to compare with, and 30 no better
    weights = [vector for _, vector in found]
    np.testing.assert_allclose(weights[0], weights[5], atol=1e-6)
    assert np.abs(weights[5] - weights[6]).max() > 0.1
    assert np.abs(weights[11] - weights[12]).max() > 0.1


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"policy": RecurrentPolicy(3, Deterministic(1))}, "^policy must sample its actions"),
        ({"variance_scaled": True}, "^variance_scaled must be false: it needs a Gaussian policy, .* Categorical"),
    ],
)
def test_a_policy_without_the_gradient_asked_for_is_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        small_rpg(**settings)


def test_an_infinite_reward_stops_the_run_and_names_the_episode() -> None:
    rpg = small_rpg(batch_size=4)
    assert isinstance(rpg.rollouts, LaneEngine)
    rpg.rollouts.kernel.floats[:] = np.where(rpg.rollouts.kernel.floats < 0, np.nan, rpg.rollouts.kernel.floats)
    with pytest.raises(FloatingPointError, match="episode"):
        rpg.update()


BEST_WITHOUT_MEMORY = 1.95  # half of the signs are right: (4 - 0.1) / 2, exact


@pytest.mark.parametrize("core", [name for name, kind in CORES.items() if kind.states])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_recurrent_core_learns_what_no_memoryless_policy_can(core: str, seed: int) -> None:
    rpg = RPG("dpsearch/TMaze-v0", env_kwargs={"corridor_length": 5}, policy=PolicyConfig(core=core), seed=seed)
    rpg.learn(total_steps=3_000_000, until_solved=True)
    assert rpg.solved
    assert rpg.evaluate(1000).mean_return > 3.5


def test_without_memory_the_best_is_half_of_the_signs() -> None:
    rpg = RPG("dpsearch/TMaze-v0", env_kwargs={"corridor_length": 5}, policy=PolicyConfig(core="none"), seed=0)
    rpg.learn(total_updates=800, until_solved=True)
    assert not rpg.solved
    assert rpg.evaluate(2000).mean_return < BEST_WITHOUT_MEMORY + 0.3


def test_an_environment_without_a_kernel_is_learned_too() -> None:
    rpg = RPG("CartPole-v1", gamma=0.99, seed=0)
    assert rpg.evaluate(50).mean_return < 40.0  # a random policy's 22
    rpg.learn(total_updates=45)
    assert rpg.evaluate(50).mean_return > 100.0
