"""The history baseline: an LSTM that predicts returns from the history."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch

from dpsearch.algos import RPG
from dpsearch.algos.baselines.history import HistoryBaseline, HistoryConfig
from dpsearch.policies import PolicyConfig, RecurrentPolicy
from dpsearch.rollout import Episodes, make_rollouts

ROLLOUTS = make_rollouts("dpsearch.envs:dpsearch/TMaze-v0", env_kwargs={"corridor_length": 4})
POLICY = RecurrentPolicy.for_spaces(ROLLOUTS.observation_space, ROLLOUTS.action_space, PolicyConfig())


def episodes(n: int, key: int = 1) -> Episodes:
    return ROLLOUTS.collect(POLICY, n, key=key)


def baseline(steps: int = 1) -> HistoryBaseline:
    return HistoryBaseline(HistoryConfig(steps=steps), POLICY, seed=0)


def learned(batches: int) -> HistoryBaseline:
    trained = baseline(steps=20)
    for key in range(batches):
        played = episodes(50, key)
        trained(played, torch.empty(0), played.returns_to_go(0.98), played.mask)
    return trained


def test_it_learns_what_to_expect_at_each_step_of_episodes_it_has_not_seen() -> None:
    played = episodes(300, key=99)
    returns, mask = played.returns_to_go(0.98), played.mask
    error = (returns - learned(10).expected(played))[mask]
    assert error.var() < 0.96 * returns[mask].var()  # most of it is luck; no constant would be below 1


def test_what_it_expects_does_not_depend_on_the_action_taken_then_or_later() -> None:
    played, trained = episodes(5), learned(2)
    expected = trained.expected(played)
    t = int(played.lengths.min()) // 2
    changed = replace(played, actions=played.actions.copy())
    changed.actions[t:] = 3 - changed.actions[t:]
    after = trained.expected(changed)
    np.testing.assert_array_equal(after[: t + 1], expected[: t + 1])
    assert (after[t + 1] != expected[t + 1]).any()


def test_the_size_of_returns_does_not_matter() -> None:
    played = episodes(40)
    returns, mask = played.returns_to_go(0.98), played.mask
    small, large = baseline(), baseline()
    for _ in range(10):
        small(played, torch.empty(0), returns, mask)
        large(played, torch.empty(0), 1000 * returns, mask)
    np.testing.assert_allclose(large.expected(played)[mask], 1000 * small.expected(played)[mask], rtol=1e-2, atol=5.0)


def test_state_goes_on_bit_for_bit() -> None:
    played = episodes(20)
    returns, mask = played.returns_to_go(0.98), played.mask
    whole, copy = learned(2), baseline(steps=20)
    copy.load_state_dict(deepcopy(whole.state_dict()))
    for each in (whole, copy):
        each(played, torch.empty(0), returns, mask)
    np.testing.assert_array_equal(whole.expected(played), copy.expected(played))


def test_batches_of_one_return_have_a_scale() -> None:
    """As where a batch is one episode that is rewarded at its end only, without discount."""
    played, trained = episodes(1), baseline(steps=20)
    mask = played.mask
    for k in range(60):
        returns = np.where(mask, np.float32(1.0 if k % 2 else -1.0), np.float32(0.0))
        trained(played, torch.empty(0), returns, mask)
    expected = trained.expected(played)[mask]
    assert (np.abs(expected) < 1.5).all()
    assert 0.9 < trained.state_dict()["returns"][-1] < 1.1  # of returns that are 1 and -1 in turn


def test_a_gradient_that_explodes_is_not_followed() -> None:
    """As when a recurrent weight has grown, in episodes of thousands of steps."""
    trained, played = learned(1), episodes(20)
    state = trained.state_dict()
    for name, weights in state["net"].items():
        if "weight_hh" in name:
            weights.fill_(1e30)
    trained.load_state_dict(state)
    trained(played, torch.empty(0), played.returns_to_go(0.98), played.mask)
    assert all(bool(weights.isfinite().all()) for weights in trained.state_dict()["net"].values())


def test_options_that_do_not_fit_the_optimiser_are_named() -> None:
    with pytest.raises(ValueError, match=r"^baseline\.optimizer_options do not fit Adam"):
        RPG("dpsearch/TMaze-v0", baseline={"kind": "history", "optimizer_options": {"momentum": 0.9}})
