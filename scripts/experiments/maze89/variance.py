"""The variance of RPG's gradient in the 89-state maze, with and without baselines (section 3.3.2)."""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from dpsearch.algos import RPG
from dpsearch.algos.baselines.history import HistoryBaseline
from dpsearch.kernels.philox import stream_key
from dpsearch.rollout import Episodes
from scripts.experiments.jobs import Outcome
from scripts.experiments.learning import learn
from scripts.experiments.training import compose

BATCHES = 100  # of 50 episodes, whose gradients' variance is taken
PLAYED = 8  # purpose of the seed's stream that they are drawn from
CONSTANT, HISTORY, BOTH = "constant", "history", "history_by_constant"
WORDS = {
    CONSTANT: "constant baseline, by none",
    HISTORY: "history baseline, by none",
    BOTH: "history by constant",
}


def measure(overrides: tuple[str, ...], seed: int) -> Outcome:
    """Learn for a while, then compute the variance of the gradient at the policy as it is then, with each baseline.

    The variance is the sum of the variances of all components, over batches that nothing has learned from.
    """
    algorithm = learn(compose(overrides), seed).algorithm
    assert isinstance(algorithm, RPG)
    assert isinstance(algorithm.baseline, HistoryBaseline)
    key, size = stream_key(seed, PLAYED), algorithm.config.batch_size
    batches = [
        algorithm.rollouts.collect(algorithm.policy, size, key=key, first_episode=size * k) for k in range(BATCHES)
    ]
    gamma = algorithm.config.gamma
    total = sum(float(batch.returns_to_go(gamma).sum()) for batch in batches)
    mean = total / sum(batch.steps for batch in batches)
    found: dict[str, list[NDArray[np.float32]]] = {"none": [], CONSTANT: [], HISTORY: []}
    for batch in batches:
        returns, mask = batch.returns_to_go(gamma), batch.mask
        for name, baseline in (("none", 0.0), (CONSTANT, mean), (HISTORY, algorithm.baseline.expected(batch))):
            found[name].append(_gradient(algorithm, batch, (returns - baseline) * mask))
    variance = {name: float(np.var(gradients, axis=0, ddof=1).sum()) for name, gradients in found.items()}
    return {
        "solved": 1,
        CONSTANT: variance[CONSTANT] / variance["none"],
        HISTORY: variance[HISTORY] / variance["none"],
        BOTH: variance[HISTORY] / variance[CONSTANT],
    }


def _gradient(algorithm: RPG, batch: Episodes, weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """The estimate of section 3.3.2 with given R_t - b ``(T, N)``, flat."""
    policy = algorithm.policy
    observations, actions = torch.from_numpy(batch.observations), torch.from_numpy(batch.actions)
    outputs = policy.distribution(policy.unroll(observations, actions, batch.lengths), actions)
    eligibilities, _ = policy.head.eligibilities(
        outputs.detach(), actions, torch.from_numpy(weights.astype(np.float32) / len(batch))
    )
    parts = torch.autograd.grad(outputs, policy.free_parameters(), eligibilities)
    return np.concatenate([part.numpy().ravel() for part in parts])
