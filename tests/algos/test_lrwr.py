"""Episodic logistic reward-weighted regression, chapter 6."""

from __future__ import annotations

from dataclasses import replace
from typing import Any
from unittest.mock import patch

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces

from dpsearch.algos import LRWR, LRWRConfig
from dpsearch.algos.lrwr import adapted_tau
from dpsearch.algos.unroll import unroll
from dpsearch.policies import Deterministic, PolicyConfig, RecurrentPolicy
from dpsearch.rollout import Episodes
from scripts.experiments.training import compose

TIGER = "dpsearch.envs:dpsearch/Tiger-v0"
TMAZE = "dpsearch.envs:dpsearch/TMaze-v0"
ADAM: dict[str, Any] = {"optimizer": "Adam", "learning_rate": 0.03}


def one_choice(**settings: Any) -> LRWR:
    """Listen, or open one of two doors; then it is over. Nothing is seen before."""
    return LRWR(TIGER, max_episode_steps=1, gamma=1.0, policy=PolicyConfig(core="none", hidden_size=1), **settings)


def probabilities(lrwr: LRWR) -> Any:
    outputs, _ = lrwr.policy(torch.zeros(1, 1, 2))
    return outputs[0, 0].softmax(0).detach().numpy()


def imitate(lrwr: LRWR, episodes: Episodes, utilities: Any) -> int:
    episodes = episodes.first(lrwr.horizon)
    utilities = np.broadcast_to(utilities, episodes.mask.shape)
    return lrwr.imitate(episodes, utilities, unroll(lrwr.policy, episodes), episodes.returns_to_go(0.98))


def test_an_em_step_repeats_each_choice_as_often_as_it_is_worth() -> None:
    """The solution of (6.3) in closed form: pi(a) = sum of u where a was chosen / sum of u."""
    settings: dict[str, Any] = {"tau": 0.01, "held_out": 0.0, "max_epochs": 800, "optimizer": "Adam"}
    episodes = one_choice().play_batch(400)  # those that an algorithm of the same seed will learn from
    lrwr = one_choice(batch_size=400, learning_rate=0.02, control_variate=False, **settings).learn(total_updates=1)
    weights = np.exp(0.01 * episodes.rewards[0].astype(float))
    expected = np.bincount(episodes.actions[0, :, 0].astype(int), weights, minlength=3) / weights.sum()
    np.testing.assert_allclose(probabilities(lrwr), expected, atol=2e-3)


@pytest.mark.parametrize("on", [False, True])
def test_only_with_a_control_variate_choices_worth_the_same_stay_as_likely_as_they_are(on: bool) -> None:
    """Without, the policy comes to repeat what it happened to do."""
    policy = PolicyConfig(core="none", hidden_size=1, init_range=1.0)
    lrwr = LRWR(TIGER, max_episode_steps=1, policy=policy, held_out=0.0, max_epochs=300, control_variate=on)
    before = probabilities(lrwr)
    imitate(lrwr, lrwr.play_batch(30), 0.7)
    moved = np.abs(probabilities(lrwr) - before).max()
    assert moved < 1e-5 if on else moved > 0.02


def test_a_control_variate_leaves_the_solution_what_it_is_on_average() -> None:
    """That of (6.3) for all episodes there could be: pi(a) u(a) / sum of pi u, for u that depends on the action."""
    lrwr = one_choice(held_out=0.0, max_epochs=1500, optimizer="Adam", learning_rate=0.01)
    before, worth = probabilities(lrwr), np.array([0.2, 0.5, 1.0])
    episodes = lrwr.play_batch(40_000)
    imitate(lrwr, episodes, worth[episodes.actions[0, :, 0].astype(int)])
    np.testing.assert_allclose(probabilities(lrwr), before * worth / (before @ worth), atol=0.02)


@pytest.mark.parametrize("on", [False, True])
def test_steps_count_by_their_discount(on: bool) -> None:
    """The gradient by the read-out's biases is the sum over steps of gamma^t (one-hot - p), at p = 1/4."""
    lrwr = LRWR(
        TMAZE, held_out=0.0, max_epochs=1, optimizer_options={}, learning_rate=1e-3, gamma=0.9, discount_steps=on,
        control_variate=False, policy=PolicyConfig(init_range=0.0),
    )  # fmt: skip
    whole = lrwr.play_batch(30)
    episodes = whole.first(lrwr.horizon)
    assert (len(episodes.rewards) < len(whole.rewards)) == on  # what counts for less than a thousandth is left out
    fading = 0.9 ** np.arange(len(episodes.rewards)) if on else np.ones(len(episodes.rewards))
    taken = np.eye(4)[episodes.actions[..., 0].astype(int)] - 0.25  # (T, N, 4)
    expected = 1e-3 * (taken * (fading[:, None] * episodes.mask)[..., None]).sum((0, 1))
    imitate(lrwr, whole, 1.0)
    np.testing.assert_allclose(lrwr.policy.vector()[-4:], expected, atol=1e-6)


def test_of_a_long_episode_the_first_steps_are_imitated_by_the_return_of_the_whole() -> None:
    settings: dict[str, Any] = {"held_out": 0.0, "optimizer_options": {}, "max_epochs": 1, "control_variate": False}
    cut, whole = (LRWR(TMAZE, imitated_steps=steps, **settings) for steps in (3, None))
    cut.update()
    whole.update()
    assert cut.tau == whole.tau  # which is made of the returns: those of three steps would be all but alike
    by_hand = LRWR(TMAZE, **settings)
    episodes = by_hand.play_batch(30)
    returns = episodes.returns_to_go(0.98)[0].astype(float)
    tau = adapted_tau(returns, np.ones(30))
    assert tau is not None
    imitate(by_hand, episodes.first(3), np.exp(tau * (returns - returns.max())))
    np.testing.assert_allclose(cut.policy.vector(), by_hand.policy.vector(), rtol=1e-5)
    assert np.abs(cut.policy.vector() - whole.policy.vector()).max() > 1e-4


def test_where_steps_have_gains_of_their_own_the_first_are_imitated_too() -> None:
    lrwr = LRWR(TMAZE, imitated_steps=3, baseline="shared", discount_steps=False, held_out=0.0, max_epochs=1)
    with patch.object(lrwr, "imitate", wraps=lrwr.imitate) as imitation:
        lrwr.update()
    episodes, utilities, _, returns = imitation.call_args.args
    played = LRWR(TMAZE).play_batch(30)  # the same episodes
    assert len(episodes.rewards) == len(utilities) == 3
    np.testing.assert_array_equal(returns, played.returns_to_go(0.98)[:3])


def test_tau_can_be_relative_to_what_gains_have_been_like() -> None:
    lrwr = one_choice(batch_size=20, steepness=0.5)
    squares = []
    for _ in range(3):
        squares.append(float(np.square(lrwr.rollouts.collect(
            lrwr.policy, 20, key=lrwr.training_key, first_episode=lrwr.episodes
        ).returns).mean()))  # fmt: skip
        lrwr.update()
    weights = 0.98 ** np.array([2, 1, 0])
    assert lrwr.tau == pytest.approx(0.5 / np.sqrt(weights @ squares / weights.sum()), rel=1e-6)


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
    assert one_choice(tau=0.5).tau == 0.5


def test_one_gradient_step_is_that_of_the_weighted_log_likelihood() -> None:
    """Of the read-out's biases: sum of u (1 - p) where the action was taken, and of -u p elsewhere.

    A control variate replaces the mean utility's part by what it is on average: nothing, at first.
    """
    for on in (False, True):
        lrwr = one_choice(held_out=0.0, max_epochs=1, optimizer_options={}, learning_rate=1e-3, control_variate=on)
        episodes, p = lrwr.play_batch(30), probabilities(lrwr)
        utilities = np.random.default_rng(0).random(30)
        before = lrwr.policy.vector()[-3:]
        imitate(lrwr, episodes, utilities)
        one_hot = np.eye(3)[episodes.actions[0, :, 0].astype(int)]
        expected = 1e-3 * ((utilities - on * utilities.mean())[:, None] * (one_hot - p)).sum(0)
        np.testing.assert_allclose(lrwr.policy.vector()[-3:] - before, expected, rtol=1e-3, atol=1e-7)


def test_the_step_size_fades() -> None:
    lrwr = one_choice(learning_rate=0.004, learning_rate_halflife=2.0).learn(total_updates=5)
    assert lrwr.optimizer.param_groups[0]["lr"] == pytest.approx(0.001)


def test_of_training_that_does_not_generalise_one_step_is_left() -> None:
    lrwr = LRWR(TMAZE, learning_rate=1e3, max_epochs=50, patience=3)
    other = LRWR(TMAZE, learning_rate=1e3, max_epochs=1)
    episodes = lrwr.play_batch(30)
    assert imitate(lrwr, episodes, 1.0) < 50
    imitate(other, episodes, 1.0)
    np.testing.assert_array_equal(lrwr.policy.vector(), other.policy.vector())


def test_a_loss_that_is_not_finite_stops_the_run() -> None:
    with pytest.raises(FloatingPointError, match="update 0 is not finite"):
        LRWR(TMAZE, learning_rate=1e38, held_out=0.0).learn(total_updates=1)


def test_there_is_always_an_episode_to_train_on() -> None:
    lrwr = LRWR(TMAZE, batch_size=2, held_out=0.9)
    before = lrwr.policy.vector()
    episodes = lrwr.play_batch(2)
    imitate(lrwr, episodes, np.random.default_rng(0).random(episodes.mask.shape))
    assert (lrwr.policy.vector() != before).any()


def test_held_out_episodes_are_not_trained_on() -> None:
    lrwr, other = (LRWR(TMAZE, batch_size=30, patience=9, max_epochs=3, learning_rate=1e-4) for _ in range(2))
    episodes = lrwr.play_batch(30)
    changed = replace(episodes, actions=episodes.actions.copy())
    changed.actions[:, 20:] = 1.0
    for algorithm, played in ((lrwr, episodes), (other, changed)):
        imitate(algorithm, played, np.arange(30) / 30)
    np.testing.assert_array_equal(lrwr.policy.vector(), other.policy.vector())


def test_with_a_baseline_each_step_has_a_utility_of_its_own() -> None:
    lrwr = LRWR(TMAZE, baseline="shared", discount_steps=False, batch_size=10)
    episodes = lrwr.play_batch(10)
    mask, returns = episodes.mask, episodes.returns_to_go(0.98)
    gains, whose = lrwr.gains(episodes, returns, unroll(lrwr.policy, episodes))
    assert gains.shape == (mask.sum(),)
    assert sorted(whose[mask]) == list(range(mask.sum()))
    np.testing.assert_allclose(gains[whose[mask]], returns[mask])  # at first it expects 0


def test_the_baseline_learns_what_to_expect() -> None:
    lrwr = LRWR(
        TIGER, max_episode_steps=1, gamma=1.0, batch_size=50, baseline={"kind": "shared", "weight": 1.0},
        discount_steps=False, held_out=0.0, max_epochs=20, policy=PolicyConfig(init_range=0.3), **ADAM,
    )  # fmt: skip
    lrwr.learn(total_updates=20)
    assert lrwr.baseline is not None
    episodes = lrwr.play_batch(500)
    expected = lrwr.baseline.expected(episodes, unroll(lrwr.policy, episodes))
    assert abs(float(np.mean(expected)) - episodes.returns.mean()) < 5.0


@pytest.mark.parametrize("seed", range(3))
def test_it_learns_what_no_memoryless_policy_can(seed: int) -> None:
    settings = compose(("experiment=pomdps_lrwr", "env=tmaze", "env.corridor_length=3"))
    lrwr = settings.algorithm(settings.rollouts(), seed).learn(total_episodes=5000)
    assert lrwr.evaluate(200).mean_return > 3.8  # without memory at most 1.95


def test_squared_error_learns_too() -> None:
    settings: dict[str, Any] = {"loss": "squared", "control_variate": False, "batch_size": 75, "max_epochs": 30}
    lrwr = LRWR(TMAZE, env_kwargs={"corridor_length": 3}, **settings, **ADAM)
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
    lrwr = LRWR(Target, max_episode_steps=1, batch_size=60, steepness=2.0, **ADAM)
    lrwr.learn(total_updates=50)
    outputs, _ = lrwr.policy(torch.zeros(1, 1, 1))
    mean, std = outputs[0, 0, 0].item(), torch.sigmoid(outputs[0, 0, 1]).item()
    assert abs(mean - 0.6) < 0.15
    assert std < 0.2  # 0.5 at first


def test_a_squared_error_of_continuous_actions_is_refused_before_anything_is_played() -> None:
    with pytest.raises(ValueError, match=r"^loss must be likelihood: squared needs discrete actions"):
        LRWR(Target, max_episode_steps=1, loss="squared", control_variate=False)


def test_a_policy_that_does_not_sample_its_actions_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^policy must sample its actions, this one's head is Deterministic"):
        LRWR(Target, max_episode_steps=1, policy=RecurrentPolicy(1, Deterministic(1)))


@pytest.mark.parametrize("settings", [{}, {"baseline": "shared", "discount_steps": False, "steepness": 0.3, **ADAM}])
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
        ("batch_size", 1), ("imitated_steps", 2.5), ("gamma", 0.0), ("baseline", "linear"),
        ("baseline", {"kind": "shared", "weight": -1.0}),
        ("tau", 0.0), ("steepness", 0.0), ("learning_rate_halflife", -1.0),
        ("loss", "l1"),
        ("held_out", 1.0), ("patience", 0), ("max_epochs", 2.5), ("optimizer", "Sgd"), ("learning_rate", np.inf),
    ],
)  # fmt: skip
def test_a_setting_out_of_range_is_named(setting: str, value: Any) -> None:
    with pytest.raises(ValueError, match=setting):
        LRWRConfig(**{setting: value})


def test_settings_that_exclude_each_other_are_named() -> None:
    with pytest.raises(ValueError, match="discount_steps must be false with a baseline"):
        LRWRConfig(baseline="shared")
    with pytest.raises(ValueError, match="control_variate must be false with loss=squared"):
        LRWRConfig(loss="squared")
    with pytest.raises(ValueError, match="tau, which it takes the place of, must be null"):
        LRWRConfig(steepness=0.2, tau=1.0)


def test_options_that_the_optimiser_does_not_take_are_refused_before_anything_is_played() -> None:
    with pytest.raises(ValueError, match="optimizer_options do not fit Adam, which takes amsgrad, betas"):
        LRWR(TMAZE, optimizer="Adam", optimizer_options={"momentum": 0.9})
