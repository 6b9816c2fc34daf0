import numpy as np
import pytest

from dpsearch.rollout import Episodes


def some_episodes() -> Episodes:
    lengths = np.array([3, 1, 5, 2])
    mask = np.arange(5)[:, None] < lengths
    rng = np.random.default_rng(0)
    return Episodes(
        observations=np.where(mask[..., None], rng.normal(size=(5, 4, 2)), 0.0).astype(np.float32),
        actions=np.zeros((5, 4, 1), np.float32),
        rewards=np.where(mask, rng.normal(size=(5, 4)), 0.0).astype(np.float32),
        lengths=lengths,
        terminated=np.array([True, False, True, True]),
        returns=np.zeros(4),
    )


@pytest.mark.parametrize("gamma", [0.0, 0.5, 0.98, 1.0])
def test_returns_to_go_are_those_of_a_plain_loop(gamma: float) -> None:
    episodes = some_episodes()
    returns = episodes.returns_to_go(gamma)
    assert returns.dtype == np.float32
    for b, length in enumerate(episodes.lengths):
        for t in range(5):
            expected = sum(gamma ** (k - t) * episodes.rewards[k, b] for k in range(t, length))
            assert returns[t, b] == pytest.approx(expected, rel=1e-6, abs=1e-6)
        assert not returns[length:, b].any()


def test_rewards_that_lie_beyond_an_episode_do_not_count() -> None:
    episodes = some_episodes()
    before = episodes.returns_to_go(0.9)
    episodes.rewards[~episodes.mask] = np.nan
    np.testing.assert_array_equal(episodes.returns_to_go(0.9), before)


def test_it_counts_episodes_and_steps() -> None:
    episodes = some_episodes()
    assert len(episodes) == 4
    assert episodes.steps == episodes.mask.sum() == 11
    np.testing.assert_array_equal(episodes.mask.sum(axis=0), episodes.lengths)


def test_their_first_steps_are_episodes_too() -> None:
    episodes = some_episodes()
    assert episodes.first(None) is episodes.first(5) is episodes
    first = episodes.first(2)
    assert len(first.observations) == len(first.actions) == 2
    assert first.lengths.tolist() == [2, 1, 2, 2]
    assert first.terminated.tolist() == [False, False, False, True]
    np.testing.assert_allclose(first.returns, episodes.rewards[:2].sum(0), rtol=1e-6)


def test_moments_are_those_of_the_steps_played() -> None:
    episodes = some_episodes()
    values = np.random.default_rng(1).normal(1000.0, 1.0, (5, 4)).astype(np.float32)
    played = values[episodes.mask].astype(np.float64)
    assert episodes.moments(values)[0] == pytest.approx((played.mean(), played.var()), rel=1e-12)
    values[~episodes.mask] = np.nan
    assert episodes.moments(values)[0] == pytest.approx((played.mean(), played.var()), rel=1e-12)
    assert episodes.moments(np.full((5, 4), np.float32(0.1))) == [[float(np.float32(0.1)), 0.0]]
