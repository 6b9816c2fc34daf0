"""Episodic logistic reward-weighted regression, chapter 6."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces

from dpsearch.algos import LRWR, LRWRConfig
from dpsearch.algos.lrwr import adapted_tau
from dpsearch.policies import PolicyConfig
from dpsearch.rollout import Episodes

TIGER = "dpsearch.envs:dpsearch/Tiger-v0"
TMAZE = "dpsearch.envs:dpsearch/TMaze-v0"
ADAM: dict[str, Any] = {"optimizer": "Adam", "learning_rate": 0.03}


def one_choice(**settings: Any) -> LRWR:
    """Listen, or open one of two doors; then it is over. Nothing is seen before."""
    return LRWR(TIGER, max_episode_steps=1, gamma=1.0, policy=PolicyConfig(core="none", hidden_size=1), **settings)


def probabilities(lrwr: LRWR) -> Any:
    outputs, _ = lrwr.policy(torch.zeros(1, 1, 2))
    return outputs[0, 0].softmax(0).detach().numpy()


@pytest.mark.parametrize("utility", ["exponential", "rank"])
def test_an_em_step_repeats_each_choice_as_often_as_it_is_worth(utility: str) -> None:
    """The solution of (6.3) in closed form: pi(a) = sum of u where a was chosen / sum of u."""
    settings: dict[str, Any] = {"tau": 0.01, "utility": utility, "held_out": 0.0, "max_epochs": 800}
    settings |= {"optimizer": "Adam", "learning_rate": 0.02}
    episodes = one_choice().play_batch(400)  # those that an algorithm of the same seed will learn from
    lrwr = one_choice(batch_size=400, **settings).learn(total_updates=1)
    rewards, actions = episodes.rewards[0].astype(float), episodes.actions[0, :, 0].astype(int)
    if utility == "exponential":
        weights = 0.01 * np.exp(0.01 * rewards)
    else:
        order = np.unique(rewards, return_inverse=True)[1]
        at_most = np.cumsum(np.bincount(order))[order] / len(rewards)
        weights = np.where(at_most > 0.5, 2 * at_most - 1, 0)
    expected = np.bincount(actions, weights, minlength=3) / weights.sum()
    np.testing.assert_allclose(probabilities(lrwr), expected, atol=2e-3)


def test_the_best_of_a_batch_weighs_1_and_nothing_weighs_less_than_0() -> None:
    gains = np.array([-100.0, -4.0, 10.0, -4.0])
    for utility in ("exponential", "rank"):
        weights = one_choice(utility=utility).utilities(gains, 0.05)
        assert weights.max() == weights[2] == 1.0
        assert (weights >= 0).all()
        assert weights[1] == weights[3] > weights[0]
    np.testing.assert_allclose(one_choice().utilities(gains, 0.05)[0], np.exp(-5.5))


def test_tau_is_the_mean_of_one_over_what_was_gained_weighted() -> None:
    gains, weights = np.array([-3.0, 1.0, 5.0]), np.array([0.5, 0.0, 1.0])
    assert adapted_tau(gains, weights) == pytest.approx(1.5 / (0.5 * 0.0 + 1.0 * 8.0))
    assert adapted_tau(gains + 100, weights) == pytest.approx(adapted_tau(gains, weights))
    assert adapted_tau(gains * 10, weights) == pytest.approx(0.1 * (adapted_tau(gains, weights) or 0.0))
    assert adapted_tau(np.full(3, 2.0), weights) is None


def test_tau_fits_the_returns_from_the_first_batch_on_and_then_adapts() -> None:
    lrwr = one_choice()
    assert lrwr.tau is None
    lrwr.update()
    assert lrwr.tau is not None
    assert 1 / 110 < lrwr.tau < 1 / 10
    fixed = one_choice(tau=0.5, adapt_tau=False).learn(total_updates=3)
    assert fixed.tau == 0.5


def test_one_gradient_step_is_that_of_the_weighted_log_likelihood() -> None:
    """Of the read-out's biases: sum of u (1 - p) where the action was taken, and of -u p elsewhere."""
    lrwr = one_choice(held_out=0.0, max_epochs=1, optimizer_options={}, learning_rate=1e-3)
    episodes, p = lrwr.play_batch(30), probabilities(lrwr)
    utilities = np.random.default_rng(0).random(30)
    before = lrwr.policy.vector()[-3:]
    lrwr.imitate(episodes, np.broadcast_to(utilities, (1, 30)))
    one_hot = np.eye(3)[episodes.actions[0, :, 0].astype(int)]
    expected = 1e-3 * (utilities[:, None] * (one_hot - p)).sum(0)
    np.testing.assert_allclose(lrwr.policy.vector()[-3:] - before, expected, rtol=1e-3, atol=1e-7)


def test_training_that_does_not_generalise_is_undone() -> None:
    lrwr = LRWR(TMAZE, learning_rate=1e3, max_epochs=50, patience=3)
    episodes, before = lrwr.play_batch(30), lrwr.policy.vector()
    assert lrwr.imitate(episodes, np.ones(episodes.mask.shape)) < 50
    np.testing.assert_array_equal(lrwr.policy.vector(), before)


def test_a_loss_that_is_not_finite_stops_the_run() -> None:
    with pytest.raises(FloatingPointError, match="update 0 is not finite"):
        LRWR(TMAZE, learning_rate=1e38, held_out=0.0).learn(total_updates=1)


def test_there_is_always_an_episode_to_train_on() -> None:
    lrwr = LRWR(TMAZE, batch_size=2, held_out=0.9)
    before = lrwr.policy.vector()
    episodes = lrwr.play_batch(2)
    lrwr.imitate(episodes, np.ones(episodes.mask.shape))
    assert (lrwr.policy.vector() != before).any()


def test_held_out_episodes_are_not_trained_on() -> None:
    lrwr, other = (LRWR(TMAZE, batch_size=30, patience=9, max_epochs=3, learning_rate=1e-4) for _ in range(2))
    episodes = lrwr.play_batch(30)
    changed = Episodes(**{**vars(episodes), "actions": episodes.actions.copy()})
    changed.actions[:, 20:] = 1.0
    for algorithm, played in ((lrwr, episodes), (other, changed)):
        algorithm.imitate(played, np.ones(played.mask.shape))
    np.testing.assert_array_equal(lrwr.policy.vector(), other.policy.vector())


def test_with_a_history_baseline_each_step_has_a_utility_of_its_own() -> None:
    lrwr = LRWR(TMAZE, baseline="history", batch_size=10)
    episodes = lrwr.play_batch(10)
    gains, steps = lrwr._gains(episodes)
    mask = episodes.mask
    assert gains.shape == (mask.sum(),)
    assert sorted(steps[mask]) == list(range(mask.sum()))
    np.testing.assert_allclose(gains[steps[mask]], episodes.returns_to_go(0.98)[mask])  # at first it expects 0


@pytest.mark.parametrize("seed", range(3))
def test_it_learns_what_no_memoryless_policy_can(seed: int) -> None:
    lrwr = LRWR(
        TMAZE, env_kwargs={"corridor_length": 3}, seed=seed, batch_size=75, utility="rank", max_epochs=20, patience=4,
        policy=PolicyConfig(hidden_size=10, init_range=0.3, forget_bias=4.0), **ADAM,
    )  # fmt: skip
    assert lrwr.learn(total_updates=40).evaluate(200).mean_return > 3.0  # without memory at most 1.95


def test_squared_error_learns_too() -> None:
    lrwr = LRWR(TMAZE, env_kwargs={"corridor_length": 3}, loss="squared", batch_size=75, max_epochs=30, **ADAM)
    before = lrwr.evaluate(200).mean_return
    assert lrwr.learn(total_updates=15).evaluate(200).mean_return > before + 0.5


class Target(gym.Env[Any, Any]):
    """One step, which pays the less the farther the action is from 0.6."""

    observation_space = spaces.Box(0, 1, (1,))
    action_space = spaces.Box(-1, 1, (1,))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        return np.zeros(1, np.float32), -float((action[0] - 0.6) ** 2), True, False, {}


def test_gaussian_policies_find_the_best_action_and_grow_sure_of_it() -> None:
    lrwr = LRWR(Target, max_episode_steps=1, batch_size=60, utility="rank", **ADAM)
    lrwr.learn(total_updates=25)
    outputs, _ = lrwr.policy(torch.zeros(1, 1, 1))
    mean, std = outputs[0, 0, 0].item(), torch.sigmoid(outputs[0, 0, 1]).item()
    assert abs(mean - 0.6) < 0.15
    assert std < 0.2  # 0.5 at first


def test_a_squared_error_of_continuous_actions_is_refused_before_anything_is_played() -> None:
    with pytest.raises(TypeError, match="discrete"):
        LRWR(Target, max_episode_steps=1, loss="squared")


@pytest.mark.parametrize("settings", [{}, {"baseline": "history"}])
def test_state_goes_on_bit_for_bit(settings: dict[str, Any]) -> None:
    whole, first, second = (LRWR(TMAZE, env_kwargs={"corridor_length": 2}, max_epochs=5, **settings) for _ in range(3))
    whole.learn(total_updates=6)
    second.load_state_dict(first.learn(total_updates=2).state_dict())
    second.learn(total_updates=6)
    np.testing.assert_array_equal(whole.policy.vector(), second.policy.vector())
    assert whole.tau == second.tau


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("batch_size", 1), ("gamma", 0.0), ("utility", "linear"), ("baseline", "shared"), ("tau", 0.0), ("loss", "l1"),
        ("held_out", 1.0), ("patience", 0), ("max_epochs", 2.5), ("optimizer", "Sgd"), ("learning_rate", np.inf),
    ],
)  # fmt: skip
def test_a_setting_out_of_range_is_named(setting: str, value: Any) -> None:
    with pytest.raises(ValueError, match=setting):
        LRWRConfig(**{setting: value})


def test_options_that_the_optimiser_does_not_take_are_refused_before_anything_is_played() -> None:
    with pytest.raises(ValueError, match="optimizer_options do not fit Adam, which takes amsgrad, betas"):
        LRWR(TMAZE, optimizer="Adam", optimizer_options={"momentum": 0.9})
