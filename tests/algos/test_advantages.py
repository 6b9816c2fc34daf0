"""What RPG can do to advantages, and the entropy bonus beside them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dpsearch.algos import RPG
from dpsearch.algos.advantages import RunningScale, generalised_advantages
from dpsearch.policies import PolicyConfig
from tests.support.algorithms import NO_BASELINE, gradients, small_rpg


def test_an_entropy_bonus_adds_the_gradient_of_the_entropy_and_fades() -> None:
    rpg = small_rpg(batch_size=30, entropy_bonus=0.4, entropy_halflife=2.0, baseline=NO_BASELINE)
    episodes = rpg.play_batch(30)
    with_bonus = []
    for updates in (0, 2):
        rpg.updates = updates
        rpg.optimizer.zero_grad()
        rpg.backpropagate(episodes)
        with_bonus.append(gradients(rpg))
    plain = small_rpg(batch_size=30, baseline=NO_BASELINE)
    plain.play_batch(30)  # the same episodes
    plain.backpropagate(episodes)
    mask = torch.from_numpy(episodes.mask)
    outputs, _ = rpg.policy(torch.from_numpy(episodes.observations))
    rpg.optimizer.zero_grad()
    (-(rpg.policy.head.entropy(outputs) * mask).sum() / 30).backward()
    for bonus, both in zip((0.4, 0.2), with_bonus, strict=True):
        np.testing.assert_allclose(both, gradients(plain) + bonus * gradients(rpg), rtol=1e-3, atol=1e-5)


def test_the_entropy_of_gaussian_actions_counts_too_from_the_first_update_of_a_start() -> None:
    rpg = RPG(
        "dpsearch/DoublePoleHidden-v0", policy=PolicyConfig(hidden_size=3, init_range=0.3), baseline=NO_BASELINE,
        entropy_bonus=0.3, entropy_halflife=2.0,
    )  # fmt: skip
    episodes = rpg.play_batch(10)
    assert episodes.padded

    def gradient(updates: int) -> NDArray[np.float64]:
        rpg.optimizer.zero_grad()
        rpg.updates = updates
        rpg.backpropagate(episodes)
        return gradients(rpg)

    whole, half = gradient(0), gradient(2)
    outputs, _ = rpg.policy(torch.from_numpy(episodes.observations))
    rpg.optimizer.zero_grad()
    (rpg.policy.head.entropy(outputs) * torch.from_numpy(episodes.mask)).sum().div(10).backward()
    np.testing.assert_allclose(half - whole, 0.15 * gradients(rpg), rtol=1e-3, atol=1e-5)
    rpg.first_update = 2  # as after a restart
    np.testing.assert_array_equal(gradient(2), whole)


@pytest.mark.parametrize("trace", [0.0, 0.7, 1.0])
def test_advantages_are_sums_of_one_step_errors(trace: float) -> None:
    rpg = small_rpg(trace=trace, gamma=0.9)
    episodes = rpg.play_batch(6)
    random, mask = np.random.default_rng(0), episodes.mask
    expected = (random.normal(size=mask.shape) * mask).astype(np.float32)
    surprises = (episodes.returns_to_go(0.9) - expected) * mask
    advantages = generalised_advantages(episodes, surprises, 0.9, trace)
    for n in range(6):
        length, rewards, b = episodes.lengths[n], episodes.rewards[:, n], np.append(expected[:, n], 0.0)
        errors = [rewards[t] + 0.9 * (b[t + 1] if t + 1 < length else 0.0) - b[t] for t in range(length)]
        sums = [sum((0.9 * trace) ** k * errors[t + k] for k in range(length - t)) for t in range(length)]
        np.testing.assert_allclose(advantages[:length, n], sums, rtol=1e-3, atol=1e-4)
        assert not advantages[length:, n].any()


def test_the_scale_is_of_many_batches_so_that_a_disaster_stays_large() -> None:
    scale, calm = RunningScale(0.98), np.full(10, 0.5, np.float32)
    for _ in range(200):
        scale.note(calm)
        assert scale.value == pytest.approx(0.5)
    scale.note(np.full(10, -100.0, np.float32))
    assert 10.0 < scale.value < 20.0  # by itself it would be 100


def test_a_scale_that_forgets_nothing_is_the_mean_over_all_batches() -> None:
    scale, sizes = RunningScale(1.0), np.array([8.0, *[0.5] * 199])
    for size in sizes:
        scale.note(np.full(10, size, np.float32))
    assert scale.value == pytest.approx(np.sqrt(np.square(sizes).mean()))


def test_a_task_in_other_units_is_learned_alike_when_advantages_are_scaled() -> None:
    """Only then: the gradient of the first batch is the same."""
    gradients_of = []
    for factor in (1.0, 1000.0):
        rpg = small_rpg(normalise_advantages=True, entropy_bonus=0.1, baseline=NO_BASELINE)
        episodes = rpg.play_batch(20)
        rpg.backpropagate(dataclasses.replace(episodes, rewards=np.float32(factor) * episodes.rewards))
        gradients_of.append(gradients(rpg))
    first, second = gradients_of
    np.testing.assert_allclose(first, second, rtol=1e-3, atol=1e-6)


def test_the_learning_rate_halves() -> None:
    rpg = small_rpg(learning_rate=0.8, learning_rate_halflife=3.0).learn(total_updates=7)
    assert rpg.optimizer.param_groups[0]["lr"] == pytest.approx(0.8 / 4)
