"""Running episodes of similar length together, so that a few long ones do not make all others pay for padding."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

STEP_COST, CALL_COST = 12, 700
"""Cost of one more time step, and of one more call, of a fused LSTM, in columns of one step (measured, 10 cells)."""
WORTH_IT = 0.85
"""Episodes are split into two groups only if that brings the cost down to this part."""


def buckets(lengths: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Group episodes of similar length; one group if splitting does not pay.

    Args:
        lengths: Steps of each episode, ``(B,)``.

    Returns:
        Indices of the episodes of each group, the longest episode first; together they are all B.
    """
    if lengths.min() == lengths.max():
        return [np.arange(len(lengths))]
    order = np.argsort(-lengths, kind="stable")
    return _split(order, lengths[order])


def _split(order: NDArray[np.int64], falling: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Split episodes, given by their indices and their falling lengths, at the best place, and each part again."""
    n = len(order)
    if n < 2:
        return [order]
    cuts = np.arange(1, n)
    costs = falling[0] * (STEP_COST + cuts) + falling[cuts] * (STEP_COST + n - cuts) + CALL_COST
    cut = int(costs.argmin())
    if costs[cut] > WORTH_IT * falling[0] * (STEP_COST + n):
        return [order]
    return [*_split(order[: cut + 1], falling[: cut + 1]), *_split(order[cut + 1 :], falling[cut + 1 :])]


def run_in_buckets(run: Callable[[Tensor], Tensor], inputs: Tensor, lengths: NDArray[np.int64]) -> Tensor:
    """A recurrent core's features of episodes of different lengths, with a call for each group of similar length.

    Args:
        run: Runs the core from zero states: ``(T, B, I)`` to ``(T, B, H)`` for any T and B.
        inputs: ``(T, B, I)``, one episode a column.
        lengths: Steps of each episode, ``(B,)``; the longest has T.

    Returns:
        Features ``(T, B, H)``; beyond an episode's end they are zero, or the core's response to the padding.
    """
    if lengths.sum() == len(inputs) * len(lengths):  # equal lengths: a short batch is spared the search for groups
        return run(inputs)
    groups = buckets(lengths)
    if len(groups) == 1:
        return run(inputs)
    parts = []
    for group in groups:
        features = run(inputs[: lengths[group[0]], group])
        parts.append(torch.nn.functional.pad(features, (0, 0, 0, 0, 0, len(inputs) - len(features))))
    back = np.argsort(np.concatenate(groups))
    return torch.cat(parts, 1)[:, back]
