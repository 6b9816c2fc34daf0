"""Episodes: a batch of whole episodes, time-major, one episode a column, padded at the end."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from dpsearch.kernels.on_demand import on_demand


@on_demand()
def _discount(values, lengths, factor, sums):
    carried = np.zeros(lengths.shape[0])
    for t in range(values.shape[0] - 1, -1, -1):
        for b in range(lengths.shape[0]):
            if t < lengths[b]:
                carried[b] = values[t, b] + factor * carried[b]
                sums[t, b] = carried[b]


@on_demand()
def _moments(arrays, lengths, moments):
    count = lengths.sum()
    for i in range(len(arrays)):
        values = arrays[i]
        origin = np.float64(values[0, 0])  # of the squares, so that none of their digits are lost
        sums, squares = np.zeros(lengths.shape[0]), np.zeros(lengths.shape[0])
        for t in range(values.shape[0]):
            for b in range(lengths.shape[0]):
                distance = values[t, b] - origin if t < lengths[b] else 0.0
                sums[b] += distance
                squares[b] += distance * distance
        mean = sums.sum() / count
        moments[i, 0] = origin + mean
        moments[i, 1] = max(squares.sum() / count - mean * mean, 0.0)


@on_demand()
def clear_padding(observations, actions, rewards, lengths):
    """Zero what lies beyond the end of each episode, up to the end of the longest; returns its length.

    Arrays are (T, B, ..), with T at least that.
    """
    longest = lengths.max()
    for t in range(lengths.min(), longest):
        for b in range(lengths.shape[0]):
            if t >= lengths[b]:
                observations[t, b] = 0.0
                actions[t, b] = 0.0
                rewards[t, b] = 0.0
    return longest


@dataclass(frozen=True)
class Episodes:
    """B episodes, the longest of T steps.

    Attributes:
        observations: ``(T, B, O)`` float32; entry t is what the policy saw before action t.
        actions: ``(T, B, A)`` float32; discrete actions as whole numbers.
        rewards: ``(T, B)`` float32; entry t was paid for action t.
        lengths: ``(B,)`` int64, steps of each episode. What lies beyond is zero.
        terminated: ``(B,)`` bool, True if the task ended the episode, False if the step cap did.
        returns: ``(B,)`` float64, undiscounted.
    """

    observations: NDArray[np.float32]
    actions: NDArray[np.float32]
    rewards: NDArray[np.float32]
    lengths: NDArray[np.int64]
    terminated: NDArray[np.bool_]
    returns: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.lengths)

    @cached_property
    def steps(self) -> int:
        """Environment steps in all episodes together."""
        return int(self.lengths.sum())

    @property
    def count(self) -> int:
        """Number of episodes that a mean over episodes divides by."""
        return len(self)

    @property
    def goes_on(self) -> bool:
        """Whether some episodes go on beyond these arrays, so that ``returns_to_go`` needs ``expected``."""
        return False

    @property
    def padded(self) -> bool:
        """Whether some episodes are shorter than others."""
        return self.steps < self.rewards.size

    @cached_property
    def mask(self) -> NDArray[np.bool_]:
        """``(T, B)``, True on the steps that were played."""
        mask: NDArray[np.bool_] = np.arange(len(self.rewards))[:, None] < self.lengths
        return mask

    @property
    def seen(self) -> NDArray[np.int64]:
        """``(B,)``, observations of each episode that there are; of one that is not over, one more than its steps."""
        return self.lengths

    @property
    def state(self) -> NDArray[np.float32] | None:
        """``(B, state_size)``, the recurrent state before the first step; None for zeros."""
        return None

    def first(self, steps: int | None) -> Self:
        """As if no episode had gone on after so many steps; all of them if None."""
        if steps is None or steps >= len(self.rewards):
            return self
        return replace(
            self,
            observations=self.observations[:steps],
            actions=self.actions[:steps],
            rewards=self.rewards[:steps],
            lengths=np.minimum(self.lengths, steps),
            terminated=self.terminated & (self.lengths <= steps),
            returns=self.rewards[:steps].sum(0, dtype=np.float64),
        )

    def returns_to_go(self, gamma: float, expected: NDArray[np.float32] | float | None = None) -> NDArray[np.float32]:
        """R_t, the discounted return from step t on, ``(T, B)``; zero beyond an episode's end (section 2.1).

        Args:
            gamma: Discount factor.
            expected: What to expect from each step on, ``(T, B)`` or everywhere the same. Only what is not over, and
                was cut off, needs it.
        """
        return self.discounted(self.rewards, gamma)

    def discounted(
        self, values: NDArray[np.float32], factor: float, lengths: NDArray[np.int64] | None = None
    ) -> NDArray[np.float32]:
        """Of values ``(T, B)``, sum_k factor^k values[t + k] to an episode's end, ``(T, B)``; zero beyond it.

        Args:
            values: To be summed.
            factor: Their discount.
            lengths: Of the columns, ``(B,)``, if it is not that of the episodes.
        """
        sums = np.zeros_like(values)
        _discount(np.ascontiguousarray(values), self.lengths if lengths is None else lengths, factor, sums)
        return sums

    def moments(self, *values: NDArray[np.float32]) -> list[list[float]]:
        """Mean and variance of each of one or three arrays ``(T, B)`` over the steps that were played."""
        moments = np.empty((len(values), 2))
        _moments(tuple(np.ascontiguousarray(v, np.float32) for v in values), self.lengths, moments)
        return moments.tolist()
