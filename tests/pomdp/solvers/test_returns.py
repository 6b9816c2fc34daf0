from typing import Any

import numpy as np
import pytest

from dpsearch.pomdp.solvers.returns import discounted_sums, metrics
from dpsearch.rollout.episodes import Episodes


def test_the_metrics_of_two_episodes_are_those_worked_out_by_hand() -> None:
    found = metrics(returns=[6.0, 2.0], discounted=[5.0, 1.0], lengths=[3, 1])
    assert (found.episode_return.value, found.episode_return.standard_error) == (4.0, 2.0)
    assert found.reward_per_step.value == 2.0
    assert found.reward_per_step.standard_error == 0.0  # both earn 2 a step
    assert (found.thesis_metric.value, found.thesis_metric.standard_error) == (2.0, 0.0)
    assert (found.discounted_return.value, found.discounted_return.standard_error) == (3.0, 2.0)
    assert (found.steps.value, found.steps.standard_error) == (2.0, 1.0)


def test_ratio_of_sums_and_mean_of_ratios_differ_where_lengths_do() -> None:
    found = metrics([1.0, 1.0], [1.0, 1.0], [1, 9])
    assert found.reward_per_step.value == pytest.approx(0.2)
    assert found.thesis_metric.value == pytest.approx((1 + 1 / 9) / 2)


def test_standard_errors_are_the_spread_of_the_metrics_over_many_samples() -> None:
    rng = np.random.default_rng(0)
    samples = []
    for _ in range(2_000):
        lengths = rng.geometric(0.2, 200)
        returns = 3.0 - 0.5 * lengths + rng.normal(size=200)
        samples.append(metrics(returns, 0.5 * returns, lengths))
    for name in ("episode_return", "reward_per_step", "thesis_metric", "discounted_return", "steps"):
        estimates = [getattr(sample, name) for sample in samples]
        spread = np.std([estimate.value for estimate in estimates])
        assert np.mean([estimate.standard_error for estimate in estimates]) == pytest.approx(spread, rel=0.05)


def test_a_single_episode_has_no_standard_error() -> None:
    found = metrics([1.0], [1.0], [4])
    assert found.thesis_metric.value == 0.25
    assert np.isnan(found.thesis_metric.standard_error)
    assert np.isnan(found.reward_per_step.standard_error)


def test_discounted_sums_are_the_returns_to_go_from_the_start() -> None:
    rng = np.random.default_rng(1)
    lengths = np.array([3, 1, 5])
    rewards = np.where(np.arange(5)[:, None] < lengths, rng.normal(size=(5, 3)), 0).astype(np.float32)
    nothing = np.zeros((5, 3, 1), np.float32)
    episodes = Episodes(
        nothing, nothing, rewards, lengths, np.ones(3, np.bool_), rewards.sum(axis=0).astype(np.float64)
    )
    np.testing.assert_allclose(discounted_sums(rewards, 0.9), episodes.returns_to_go(0.9)[0], rtol=1e-5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0], [1.0, 2.0], [1]), "shapes must be"),
        (([[1.0]], [[1.0]], [[1]]), "shapes must be"),
        (([], [], []), "there must be an episode"),
        (([1.0], [1.0], [0]), "each must have a step"),
    ],
)
def test_what_is_not_a_set_of_episodes_is_refused(arguments: tuple[Any, Any, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        metrics(*arguments)
