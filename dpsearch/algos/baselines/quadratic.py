"""What return to expect from what is seen: the quadratic function that fits the returns of late best.

There is nothing to be tuned and nothing to converge: after one update it knows what one update can tell, where a
network needs hundreds. It remembers nothing of the history, though.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from typing_extensions import override

from dpsearch.algos.baselines.base import Baseline, Counted
from dpsearch.rollout import Episodes

MEMORY = 0.95  # of what was seen, from update to update
RIDGE = 3e-2  # times the steps in memory: what a coefficient's square costs
FARTHEST = 6.0  # what is beyond counts as being there, so that nothing far out decides all


class QuadraticBaseline(Baseline):
    """b(o_t) is a quadratic function of the observation, by least squares over the returns received.

    Recent updates count most, and the present one not at all, so that it cannot bias the gradient.

    Args:
        observation_size: Length O of an observation.
    """

    def __init__(self, observation_size: int) -> None:
        self._pairs = np.triu_indices(observation_size + 1)  # of (1, o), which has all products of up to two
        size = len(self._pairs[0])
        self._products, self._targets = np.zeros((size, size)), np.zeros(size)
        self._coefficients = np.zeros(size)
        self._range = (0.0, 0.0)  # of the returns received

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
        """1, what is seen, and all products of two: ``(.., O)`` to ``(.., K)``."""
        seen = np.clip(observations.astype(np.float64), -FARTHEST, FARTHEST)
        seen = np.concatenate([np.ones((*seen.shape[:-1], 1)), seen], axis=-1)
        terms: NDArray[np.float64] = seen[..., self._pairs[0]] * seen[..., self._pairs[1]]
        return terms

    @override
    def state_dict(self) -> dict[str, Any]:
        """All that the rest of a run depends on."""
        parts = {"products": self._products, "targets": self._targets, "coefficients": self._coefficients}
        return {"range": self._range, **{name: torch.from_numpy(part) for name, part in parts.items()}}

    @override
    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on where ``state_dict`` was taken."""
        self._products, self._targets = state["products"].numpy(), state["targets"].numpy()
        self._coefficients, self._range = state["coefficients"].numpy(), tuple(state["range"])
