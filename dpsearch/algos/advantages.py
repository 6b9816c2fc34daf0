"""How much better than expected it went from each step on."""

from __future__ import annotations

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
