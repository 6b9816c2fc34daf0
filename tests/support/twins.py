"""The compiled twin of a policy and its torch module, run on the same observations and weights."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from numpy.typing import NDArray

from dpsearch.kernels.lanes import LANES
from dpsearch.policies import RecurrentPolicy


def random_weights(policy: RecurrentPolicy, seed: int, n: int = LANES) -> NDArray[np.float64]:
    return np.random.default_rng(seed).uniform(-0.7, 0.7, (n, len(policy.vector())))


def run_compiled(
    policy: RecurrentPolicy,
    weights: NDArray[np.float64],
    observations: NDArray[np.float64],
    greedy: bool = True,
    lanes: int = LANES,
) -> Iterator[NDArray[np.float64]]:
    """The outputs (LANES, n_outputs) at each step, for observations (T, LANES, O) and weights (P,) or (P, LANES)."""
    compiled = policy.compiled()
    packed = compiled.pack(weights.T, greedy).T if weights.ndim == 2 else compiled.pack(weights, greedy)
    packed = np.ascontiguousarray(packed)
    hidden = np.zeros((compiled.hidden_rows, LANES), packed.dtype)
    scratch = np.full((compiled.scratch_rows, LANES), np.nan, packed.dtype)  # what it holds must not matter
    output = np.full((compiled.n_outputs, LANES), np.nan)
    for observation in observations:
        rows = np.ascontiguousarray(observation.T)
        compiled.forward(compiled.sizes, packed, rows, hidden, scratch, output, lanes)
        yield output.T.copy()


def run_torch(
    policy: RecurrentPolicy, weights: NDArray[np.float64], observations: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The outputs (T, LANES, n_outputs) of the torch module, in its own precision."""
    policy.load_vector(weights)
    with torch.no_grad():
        outputs, _ = policy(torch.from_numpy(observations).to(policy.readout.weight.dtype))
    result: NDArray[np.float64] = outputs.numpy().astype(np.float64)
    return result
