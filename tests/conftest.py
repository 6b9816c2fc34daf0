"""For all tests."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dpsearch.pomdp.model import TabularPOMDP


@pytest.fixture(autouse=True, scope="session")
def one_torch_thread() -> None:
    """One thread is the fastest at the sizes here, and several get in each other's way on a busy machine."""
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def noisy_pomdp() -> TabularPOMDP:
    """Six states, three actions, four symbols; all that can be random is."""
    random = np.random.default_rng(7)
    actions, states, symbols = 3, 6, 4

    def distributions(*shape: int) -> NDArray[np.float64]:
        weights: NDArray[np.float64] = random.dirichlet(np.ones(shape[-1]), shape[:-1]) * (random.random(shape) < 0.7)
        weights[..., 0] += 0.05
        weights /= weights.sum(axis=-1, keepdims=True)
        return weights

    start = distributions(states)
    start[5] = 0
    return TabularPOMDP.from_dense(
        distributions(actions, states, states),
        distributions(actions, states, symbols),
        random.normal(size=(actions, states, states)),
        start / start.sum(),
        first_observation=distributions(states, symbols),
        features=random.normal(size=(symbols, 2)),
        terminal=[5],
        discount=0.9,
    )
