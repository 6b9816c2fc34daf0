"""The constant baseline: b is the mean of all R_t of the last episodes (sections 3.3.2 and 3.4)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor
from typing_extensions import override

from dpsearch.algos.baselines.base import Baseline, BaselineConfig, Counted
from dpsearch.algos.settings import is_whole, require
from dpsearch.policies import RecurrentPolicy
from dpsearch.rollout import Episodes


@dataclass(frozen=True)
class ConstantConfig(BaselineConfig):
    """Settings of the constant baseline.

    Attributes:
        episodes: Episodes in the moving average (thesis: 100; 1000 in the 89-state maze); 0 for no baseline, b = 0.
    """

    kind: str = field(default="constant", init=False)
    episodes: int = 100

    def __post_init__(self) -> None:
        """Raise a ValueError that names the setting if a value is out of range."""
        require(self, {"episodes": (is_whole(self.episodes, 0), "a whole number, 0 or more")})


class ConstantBaseline(Baseline):
    """b is the mean of all R_t of the last episodes before the batch, so that it cannot bias the gradient."""

    config_type = ConstantConfig

    def __init__(self, config: ConstantConfig, policy: RecurrentPolicy, seed: int) -> None:
        self._totals: deque[float] = deque(maxlen=config.episodes)  # sum of R_t of each episode
        self._lengths: deque[int] = deque(maxlen=config.episodes)  # and its steps

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
