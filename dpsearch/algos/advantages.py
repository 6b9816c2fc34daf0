"""Advantages, the returns less the baseline: smoothed over time, and scaled by their usual size."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpsearch.rollout import Episodes


def generalised_advantages(
    episodes: Episodes, surprises: NDArray[np.float32], gamma: float, trace: float
) -> NDArray[np.float32]:
    """Generalised advantage estimates (Schulman et al., ICLR 2016).

    Args:
        episodes: N episodes of up to T steps.
        surprises: R_t - b ``(T, N)``; with a trace of 1 these are the estimates.
        gamma: Discount factor of the returns R_t.
        trace: Lambda, in [0, 1].

    Returns:
        Advantages, ``(T, N)``.
    """
    if trace == 1.0:
        return surprises
    errors = surprises.copy()
    errors[:-1] -= gamma * surprises[1:]  # r_t + gamma b(h_t+1) - b(h_t)
    return episodes.discounted(errors, gamma * trace)


class RunningScale:
    """Running root mean square of the advantages.

    Args:
        memory: Decay from batch to batch, in (0, 1]; 1 averages over all batches.
    """

    def __init__(self, memory: float) -> None:
        self._memory = memory
        self._mean_square, self._batches = 0.0, 0

    def note(self, advantages: NDArray[np.floating[Any]]) -> None:
        """Note the advantages ``(M,)`` of a batch."""
        self._batches += 1
        share = 1.0 / self._batches if self._memory == 1.0 else 1.0 - self._memory
        self._mean_square += share * (float(np.square(advantages).mean()) - self._mean_square)

    @property
    def value(self) -> float:
        """The scale, once a batch was noted."""
        counted = 1.0 if self._memory == 1.0 else 1.0 - self._memory**self._batches  # the mean square starts at 0
        return max(math.sqrt(self._mean_square / counted), 1e-8)

    def state_dict(self) -> dict[str, Any]:
        """Everything that later scales depend on."""
        return {"mean_square": self._mean_square, "batches": self._batches}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from where ``state_dict`` was taken."""
        self._mean_square, self._batches = state["mean_square"], state["batches"]
