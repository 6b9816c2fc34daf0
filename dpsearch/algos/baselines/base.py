"""The interface of all baselines.

Any b that does not depend on the action taken leaves the expected gradient as it is; a good one makes it less noisy.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, nn

from dpsearch.policies import RecurrentPolicy
from dpsearch.rollout import Episodes

Counted = NDArray[np.bool_] | None
"""``(T, N)``, False for steps that a baseline is not to learn from; None for all that were played."""


@dataclass(frozen=True)
class BaselineConfig:
    """Settings of a baseline; a subclass adds them as fields.

    Attributes:
        kind: Name of the baseline.
    """

    kind: str = field(default="none", init=False)


class Baseline(ABC):
    """Predicts the return from each step on, given what was seen and done so far.

    Args:
        config: Settings, of the class ``config_type``.
        policy: The policy whose returns are predicted.
        seed: Seed of the initial weights, in [0, 2**63).

    Raises:
        ValueError: If an optimiser does not take its options.
    """

    config_type: ClassVar[type[BaselineConfig]]

    @abstractmethod
    def __init__(self, config: Any, policy: RecurrentPolicy, seed: int) -> None: ...

    @abstractmethod
    def __call__(
        self, episodes: Episodes, features: Tensor, returns: NDArray[np.float32], counted: Counted = None
    ) -> tuple[NDArray[np.float32] | float, Tensor | None]:
        """Predict the returns of a batch, then learn from the returns received.

        Args:
            episodes: N episodes of up to T steps.
            features: The policy's memory at each step, ``(T, N, H)``.
            returns: R_t, ``(T, N)``; zero on padding.
            counted: Steps to learn from, ``(T, N)``; None for all that were played.

        Returns:
            b, that broadcasts to ``(T, N)``; and a loss to add to the policy's, summed over steps, or None.
        """

    @abstractmethod
    def expected(self, episodes: Episodes, features: Tensor) -> NDArray[np.float32] | float:
        """Predict the returns of a batch, and learn nothing.

        Args:
            episodes: N episodes of up to T steps.
            features: The policy's memory at each step, ``(T, N, H)``.

        Returns:
            b, that broadcasts to ``(T, N)``.
        """

    def parameters(self) -> list[nn.Parameter]:
        """Parameters that the policy's optimiser adjusts along with the policy's own."""
        return []

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """Everything that later predictions depend on."""

    @abstractmethod
    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from where ``state_dict`` was taken."""
