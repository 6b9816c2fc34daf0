"""How much better than expected it went from each step on, and how much that usually is."""

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
        surprises: R_t - b ``(T, N)``, which the estimates are for a trace of 1.
        gamma: Discount factor of the returns R_t.
        trace: Lambda, in [0, 1].

    Returns:
        ``(T, N)``.
    """
    if trace == 1.0:
        return surprises
    errors = surprises.copy()
    errors[:-1] -= gamma * surprises[1:]  # r_t + gamma b(h_t+1) - b(h_t)
    return episodes.discounted(errors, gamma * trace)


class RunningScale:
    """Root mean square of the advantages of the last batch and, less and less, those before.

    Args:
        memory: What part of it is left after a batch, in (0, 1]; 1 for the mean over all batches.
    """

    def __init__(self, memory: float) -> None:
        self._memory = memory
        self._mean_square, self._batches = 0.0, 0

    def note(self, advantages: NDArray[np.floating[Any]]) -> None:
        """Take in those of a batch, ``(M,)``."""
        self._batches += 1
        share = 1.0 / self._batches if self._memory == 1.0 else 1.0 - self._memory
        self._mean_square += share * (float(np.square(advantages).mean()) - self._mean_square)

    @property
    def value(self) -> float:
        """The scale, after a batch at least."""
        counted = 1.0 if self._memory == 1.0 else 1.0 - self._memory**self._batches  # it begins with 0
        return max(math.sqrt(self._mean_square / counted), 1e-8)

    def state_dict(self) -> dict[str, Any]:
        """All that it remembers."""
        return {"mean_square": self._mean_square, "batches": self._batches}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Remember what it did when ``state_dict`` was taken."""
        self._mean_square, self._batches = state["mean_square"], state["batches"]
