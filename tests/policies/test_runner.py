from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dpsearch.policies import CORES, Categorical, Gaussian, Head, PolicyConfig, PolicyRunner, RecurrentPolicy

B = 6


def policy(core: str = "lstm", head: Head | None = None) -> RecurrentPolicy:
    return RecurrentPolicy(3, head or Gaussian(2), PolicyConfig(core=core, hidden_size=4, init_range=1.0))


def observations(steps: int) -> NDArray[np.float64]:
    return np.random.default_rng(0).normal(size=(steps, B, 3))


@pytest.mark.parametrize("core", list(CORES))
def test_reset_forgets_exactly_the_lanes_of_the_mask(core: str) -> None:
    mask = np.arange(B) % 2 == 0
    before, after = observations(10)[:5], observations(10)[5:]
    runner = PolicyRunner(policy(core), B, greedy=True)
    undisturbed = PolicyRunner(policy(core), B, greedy=True)
    fresh = PolicyRunner(policy(core), B, greedy=True)
    for batch in before:
        runner.act(batch)
        undisturbed.act(batch)
    runner.reset(mask)
    assert not runner.state[mask].any()
    np.testing.assert_array_equal(runner.state[~mask], undisturbed.state[~mask])
    for batch in after:
        expected = np.where(mask[:, None], fresh.act(batch), undisturbed.act(batch))
        np.testing.assert_allclose(runner.act(batch), expected, rtol=1e-6)


def test_reset_without_a_mask_forgets_everything() -> None:
    runner = PolicyRunner(policy(), B)
    runner.act(observations(1)[0])
    assert runner.state.all()
    runner.reset()
    assert not runner.state.any()


def test_a_state_that_is_set_again_brings_back_the_past() -> None:
    runner = PolicyRunner(policy(), B, greedy=True)
    first, second = observations(2)
    runner.act(first)
    kept = runner.state
    expected = runner.act(second)
    runner.act(first)
    runner.state = kept
    np.testing.assert_array_equal(runner.act(second), expected)


def test_the_same_seed_acts_the_same() -> None:
    def play(seed: int) -> list[NDArray[Any]]:
        runner = PolicyRunner(policy(head=Categorical([4])), B, seed=seed)
        return [runner.act(batch) for batch in observations(20)]

    np.testing.assert_array_equal(play(1), play(1))
    assert not np.array_equal(play(1), play(2))


def test_lanes_draw_noise_of_their_own() -> None:
    actions = PolicyRunner(policy(), B).act(np.zeros((B, 3)))
    assert len(np.unique(actions[:, 0])) == B


def test_it_follows_a_policy_that_learns() -> None:
    trained = policy()
    runner = PolicyRunner(trained, 1, greedy=True)
    before = runner.act(np.ones((1, 3)))
    trained.load_vector(trained.vector() + 1.0)
    runner.reset()
    assert not np.array_equal(runner.act(np.ones((1, 3))), before)


def test_discrete_actions_are_whole_numbers() -> None:
    actions = PolicyRunner(policy(head=Categorical([4, 2])), B).act(np.zeros((B, 3)))
    assert actions.shape == (B, 2)
    assert actions.dtype == np.int64


def test_what_does_not_fit_is_refused() -> None:
    runner = PolicyRunner(policy(), B)
    with pytest.raises(ValueError, match=r"shape \(6, 3\), got \(3,\)"):
        runner.act(np.zeros(3))
    with pytest.raises(ValueError, match="mask must be 6 truth values"):
        runner.reset(np.zeros(B - 1, np.bool_))
    with pytest.raises(ValueError, match="mask must be 6 truth values"):
        runner.reset([0, 1, 0, 1, 0, 1])
    with pytest.raises(ValueError, match="state must have shape"):
        runner.state = np.zeros((B, 3), np.float32)
    with pytest.raises(ValueError, match="num_envs"):
        PolicyRunner(policy(), 0)
