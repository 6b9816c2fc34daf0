"""Each head's compiled sampling picks the actions that its torch code picks."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dpsearch.kernels.lanes import LANES, WIDTH, noise_rows
from dpsearch.policies import Categorical, Deterministic, Gaussian, Head

HEADS = [Categorical([4]), Categorical([2, 3, 5]), Gaussian(1), Gaussian(3), Deterministic(2)]
HEADS += [Deterministic(2, squash=False)]


def choose(
    head: Head, outputs: NDArray[np.float64], uniforms: NDArray[np.float64] | None, lanes: int = LANES
) -> NDArray[np.float64]:
    """Compiled actions (LANES, A); greedy if there are no uniform numbers."""
    noise = np.full((noise_rows(head.draws), LANES), 0.5)
    if uniforms is not None:
        noise[: head.draws] = uniforms.T
    action = np.full((head.action_size, LANES), np.nan)
    function = head.compiled_mode if uniforms is None else head.compiled_sample
    function(np.array(head.layout), noise, np.ascontiguousarray(outputs.T), action, lanes)
    return action.T


@pytest.mark.parametrize("head", HEADS, ids=lambda head: f"{type(head).__name__}{head.n_outputs}")
def test_equal_uniform_numbers_pick_equal_actions(head: Head) -> None:
    rng = np.random.default_rng(9)
    for scale in (0.1, 1.0, 30.0):
        outputs = rng.normal(scale=scale, size=(LANES, head.n_outputs))
        uniforms = rng.uniform(1e-9, 1.0, (LANES, head.draws))
        expected = head.sample(torch.from_numpy(outputs), torch.from_numpy(uniforms)).numpy()
        np.testing.assert_allclose(choose(head, outputs, uniforms), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("head", HEADS, ids=lambda head: f"{type(head).__name__}{head.n_outputs}")
def test_greedy_actions_are_equal(head: Head) -> None:
    outputs = np.random.default_rng(10).normal(size=(LANES, head.n_outputs))
    outputs[0] = 0.0  # a tie
    expected = head.mode(torch.from_numpy(outputs)).numpy()
    np.testing.assert_allclose(choose(head, outputs, None), expected, rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("head", HEADS, ids=lambda head: f"{type(head).__name__}{head.n_outputs}")
@pytest.mark.parametrize("greedy", [True, False])
def test_fewer_lanes_act_the_same(head: Head, greedy: bool) -> None:
    rng = np.random.default_rng(11)
    outputs = rng.normal(size=(LANES, head.n_outputs))
    uniforms = None if greedy else rng.uniform(1e-9, 1.0, (LANES, head.draws))
    every = choose(head, outputs, uniforms)
    for lanes in range(WIDTH, LANES, WIDTH):
        np.testing.assert_array_equal(choose(head, outputs, uniforms, lanes)[:lanes], every[:lanes])


def test_extreme_uniform_numbers_pick_actions_that_exist() -> None:
    for u in (0.5 * 2.0**-32, 1.0 - 0.5 * 2.0**-32):
        uniforms = np.full((LANES, 2), u)
        picks = choose(Categorical([3, 2]), np.full((LANES, 5), -800.0), uniforms)
        np.testing.assert_array_equal(picks, np.tile([2.0, 1.0] if u > 0.5 else [0.0, 0.0], (LANES, 1)))
        assert np.isfinite(choose(Gaussian(1), np.zeros((LANES, 2)), uniforms)).all()
