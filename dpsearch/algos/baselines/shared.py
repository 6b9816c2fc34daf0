"""The shared baseline: b(h_t) is a linear read-out of the policy's own memory.

The error of the baseline flows back into the memory, which so learns to hold whatever returns depend on. While a policy
still guesses, that teaches it what to remember far faster than the policy gradient alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from typing_extensions import override

from dpsearch.algos.baselines.base import Baseline, BaselineConfig, Counted
from dpsearch.algos.settings import is_number, require
from dpsearch.policies import RecurrentPolicy
from dpsearch.rollout import Episodes


@dataclass(frozen=True)
class SharedConfig(BaselineConfig):
    """Settings of the shared baseline.

    Attributes:
        weight: Weight of the baseline's squared error in the policy's loss.
    """

    kind: str = field(default="shared", init=False)
    weight: float = 0.1

    def __post_init__(self) -> None:
        """Raise a ValueError that names the setting if a value is out of range."""
        require(self, {"weight": (is_number(self.weight) and self.weight >= 0.0, "0 or more")})


class SharedBaseline(Baseline):
    """b(h_t) is a linear read-out of the policy's own memory, regressed on the returns received."""

    config_type = SharedConfig

    def __init__(self, config: SharedConfig, policy: RecurrentPolicy, seed: int) -> None:
        self._readout = nn.Linear(policy.hidden_size, 1)
        self._weight = config.weight
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
