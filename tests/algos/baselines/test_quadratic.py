"""The quadratic baseline: least squares over what was received before."""

from __future__ import annotations

import numpy as np
import torch

from dpsearch.algos.baselines.quadratic import QuadraticBaseline, QuadraticConfig
from dpsearch.policies import Gaussian, RecurrentPolicy
from dpsearch.rollout import Episodes

NOTHING = torch.zeros(0)


def new() -> QuadraticBaseline:
    return QuadraticBaseline(QuadraticConfig(), RecurrentPolicy(2, Gaussian(1)), seed=0)


def batch(seed: int, steps: int = 500) -> tuple[Episodes, np.ndarray, np.ndarray]:
    """Observations of which returns are a quadratic function."""
    rng = np.random.default_rng(seed)
    seen = rng.uniform(-2.0, 2.0, (steps, 1, 2)).astype(np.float32)
    nothing = np.zeros((steps, 1), np.float32)
    episodes = Episodes(seen, nothing[..., None], nothing, np.array([steps]), np.array([False]), np.zeros(1))
    x, y = seen[..., 0], seen[..., 1]
    return episodes, (100.0 - 7.0 * x**2 + 3.0 * x * y + y).astype(np.float32), episodes.mask


def test_it_fits_a_quadratic_function_after_one_batch() -> None:
    baseline = new()
    first, returns, mask = batch(0)
    before, loss = baseline(first, NOTHING, returns, mask)
    assert loss is None
    assert not np.any(before)  # it must not know the batch that it judges
    second, expected, _ = batch(1)
    np.testing.assert_allclose(baseline.expected(second, NOTHING), expected, atol=2.0)


def test_it_never_expects_more_or_less_than_was_ever_received() -> None:
    baseline = new()
    first, returns, mask = batch(0)
    baseline(first, NOTHING, returns, mask)
    far, _, _ = batch(1)
    far.observations[:] *= 100.0
    expected = baseline.expected(far, NOTHING)
    assert expected.min() >= min(0.0, returns.min())
    assert expected.max() <= returns.max()


def test_it_goes_on_from_its_state() -> None:
    baseline, other = new(), new()
    first, returns, mask = batch(0)
    baseline(first, NOTHING, returns, mask)
    other.load_state_dict(baseline.state_dict())
    second, more, _ = batch(1)
    for learner in (baseline, other):
        learner(second, NOTHING, more, mask)
    np.testing.assert_array_equal(other.expected(first, NOTHING), baseline.expected(first, NOTHING))
