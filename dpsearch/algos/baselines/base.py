"""Baselines: what a return is compared with before it reinforces the actions that led to it (section 3.3.2).

Any b that does not depend on the action taken leaves the expected gradient as it is; a good one makes it less noisy.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from typing_extensions import override

from dpsearch.rollout import Episodes

Counted = NDArray[np.bool_] | None
"""``(T, N)``, False for steps that a baseline is not to learn from; all that were played if None."""


class Baseline(ABC):
    """Says what return to expect, from what was seen and done so far."""

    @abstractmethod
    def __call__(
        self, episodes: Episodes, features: Tensor, returns: NDArray[np.float32], counted: Counted = None
    ) -> tuple[NDArray[np.float32] | float, Tensor | None]:
        """The baseline for a batch, and then learn from the batch.

        Args:
            episodes: The batch.
            features: ``(T, N, H)``, the policy's memory at each step.
            returns: ``(T, N)``, R_t; zero on padding.
            counted: ``(T, N)``, False for steps that are not to be learned from; all that were played if None.

        Returns:
            b, that broadcasts to ``(T, N)``; and a loss to add to the policy's, summed over steps, or None.
        """

    @abstractmethod
    def expected(self, episodes: Episodes, features: Tensor) -> NDArray[np.float32] | float:
        """The baseline for a batch, likewise, without learning from it: what is to come when episodes are cut off."""

    def parameters(self) -> list[nn.Parameter]:
        """What the optimiser adjusts along with the policy."""
        return []

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """All that the rest of a run depends on."""

    @abstractmethod
    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on where ``state_dict`` was taken."""


class ConstantBaseline(Baseline):
    """b is the mean of all R_t of the last episodes; of those before this batch, so that it cannot bias the gradient.

    Args:
        window: Episodes to average over; 0 for b = 0.
    """

    def __init__(self, window: int) -> None:
        self._totals: deque[float] = deque(maxlen=window)  # sum of R_t of each episode
        self._lengths: deque[int] = deque(maxlen=window)  # and its steps

    @override
    def __call__(
        self, episodes: Episodes, features: Tensor, returns: NDArray[np.float32], counted: Counted = None
    ) -> tuple[float, None]:
        mean = self.expected(episodes, features)
        learned = returns if counted is None else returns * counted
        self._totals.extend(learned.sum(0, dtype=np.float64).tolist())
        self._lengths.extend((episodes.lengths if counted is None else counted.sum(0)).tolist())
        return mean, None

    @override
    def expected(self, episodes: Episodes, features: Tensor) -> float:
        return sum(self._totals) / sum(self._lengths) if self._lengths else 0.0

    @override
    def state_dict(self) -> dict[str, Any]:
        return {"episodes": [list(episode) for episode in zip(self._totals, self._lengths, strict=True)]}

    @override
    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._totals.clear()
        self._lengths.clear()
        for total, length in state["episodes"]:
            self._totals.append(total)
            self._lengths.append(length)


class SharedBaseline(Baseline):
    """b(h_t) is a linear read-out of the policy's own memory, regressed on the returns received.

    Its error flows back into the memory, which so learns to hold whatever returns depend on. While a policy still
    guesses, that teaches it what to remember far faster than the policy gradient alone.

    Args:
        features: Size H of the policy's memory.
        weight: Weight of the squared error in the loss.
    """

    def __init__(self, features: int, weight: float) -> None:
        self._readout = nn.Linear(features, 1)
        self._weight = weight
        nn.init.zeros_(self._readout.weight)
        nn.init.zeros_(self._readout.bias)

    @override
    def __call__(
        self, episodes: Episodes, features: Tensor, returns: NDArray[np.float32], counted: Counted = None
    ) -> tuple[NDArray[np.float32], Tensor]:
        expected = self._readout(features).squeeze(-1)  # (T, N)
        mask = torch.from_numpy(episodes.mask if counted is None else counted)
        error = ((torch.from_numpy(returns) - expected) * mask).square().sum()
        return expected.detach().numpy(), self._weight * error

    @override
    def expected(self, episodes: Episodes, features: Tensor) -> NDArray[np.float32]:
        with torch.no_grad():
            expected: NDArray[np.float32] = self._readout(features).squeeze(-1).numpy()
        return expected

    @override
    def parameters(self) -> list[nn.Parameter]:
        return list(self._readout.parameters())

    @override
    def state_dict(self) -> dict[str, Any]:
        return self._readout.state_dict()

    @override
    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._readout.load_state_dict(state)
