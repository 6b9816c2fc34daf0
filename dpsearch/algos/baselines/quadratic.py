"""The quadratic baseline: b(o_t) is a quadratic function of the observation, fitted to recent returns.

Least squares has nothing to tune and nothing to converge: after one update the baseline knows all that one update can
tell, where a network needs hundreds. It knows nothing of the history, though.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from typing_extensions import override

from dpsearch.algos.baselines.base import Baseline, BaselineConfig, Counted
from dpsearch.policies import RecurrentPolicy
from dpsearch.rollout import Episodes

MEMORY = 0.95  # decay of the regression's sums, from update to update
RIDGE = 3e-2  # penalty of a squared coefficient, as a part of the steps in memory
FARTHEST = 6.0  # bound of the observations, so that no outlier decides the fit


@dataclass(frozen=True)
class QuadraticConfig(BaselineConfig):
    """The quadratic baseline has no settings."""

    kind: str = field(default="quadratic", init=False)


class QuadraticBaseline(Baseline):
    """b(o_t) is a quadratic function of the observation, by least squares over the returns received.

    Recent updates count most. The present batch does not count, so that it cannot bias the gradient.
    """

    config_type = QuadraticConfig

    def __init__(self, config: QuadraticConfig, policy: RecurrentPolicy, seed: int) -> None:
        self._pairs = np.triu_indices(policy.observation_size + 1)  # of (1, o): all products of up to two numbers
        size = len(self._pairs[0])
        self._products, self._targets = np.zeros((size, size)), np.zeros(size)
        self._coefficients = np.zeros(size)
        self._range = (0.0, 0.0)  # least and greatest return received

    @override
    def __call__(
        self, episodes: Episodes, features: Tensor, returns: NDArray[np.float32], counted: Counted = None
    ) -> tuple[NDArray[np.float32], None]:
        mask = episodes.mask if counted is None else counted
        expected = self.expected(episodes, features)
        x = self._terms(episodes.observations[mask])
        self._products = MEMORY * self._products + x.T @ x
        self._targets = MEMORY * self._targets + x.T @ returns[mask]
        received = returns[mask]
        self._range = (min(self._range[0], float(received.min())), max(self._range[1], float(received.max())))
        cost = RIDGE * self._products[0, 0] * np.eye(len(self._targets))  # the first term is 1: it counts steps
        cost[0, 0] = 1e-9
        self._coefficients = np.linalg.solve(self._products + cost, self._targets)
        return expected, None

    @override
    def expected(self, episodes: Episodes, features: Tensor) -> NDArray[np.float32]:
        expected = np.clip(self._terms(episodes.observations) @ self._coefficients, *self._range)
        return expected.astype(np.float32)

    def _terms(self, observations: NDArray[np.float32]) -> NDArray[np.float64]:
        """Terms of the regression ``(.., K)``: 1, the observation ``(.., O)``, and all products of two of it."""
        seen = np.clip(observations.astype(np.float64), -FARTHEST, FARTHEST)
        seen = np.concatenate([np.ones((*seen.shape[:-1], 1)), seen], axis=-1)
        terms: NDArray[np.float64] = seen[..., self._pairs[0]] * seen[..., self._pairs[1]]
        return terms

    @override
    def state_dict(self) -> dict[str, Any]:
        parts = {"products": self._products, "targets": self._targets, "coefficients": self._coefficients}
        return {"range": self._range, **{name: torch.from_numpy(part) for name, part in parts.items()}}

    @override
    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._products, self._targets = state["products"].numpy(), state["targets"].numpy()
        self._coefficients, self._range = state["coefficients"].numpy(), tuple(state["range"])
