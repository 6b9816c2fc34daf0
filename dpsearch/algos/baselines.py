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

from dpsearch.algos.optimizers import make_optimizer
from dpsearch.policies import Head
from dpsearch.rollout import Episodes


class Baseline(ABC):
    """Says what return to expect, from what the policy remembers."""

    @abstractmethod
    def __call__(
        self, episodes: Episodes, features: Tensor, returns: NDArray[np.float32], mask: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32] | float, Tensor | None]:
        """The baseline for a batch, and then learn from the batch.

        Args:
            episodes: The batch, N episodes.
            features: ``(T, N, H)``, the policy's memory at each step.
            returns: ``(T, N)``, R_t; zero on padding.
            mask: ``(T, N)``, False on padding.

        Returns:
            b, that broadcasts to ``(T, N)``; and a loss to add to the policy's, summed over steps, or None.
        """

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
        self, episodes: Episodes, features: Tensor, returns: NDArray[np.float32], mask: NDArray[np.bool_]
    ) -> tuple[float, None]:
        mean = sum(self._totals) / sum(self._lengths) if self._lengths else 0.0
        self._totals.extend(returns.sum(0, dtype=np.float64).tolist())
        self._lengths.extend(mask.sum(0).tolist())
        return mean, None

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
        self, episodes: Episodes, features: Tensor, returns: NDArray[np.float32], mask: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], Tensor]:
        expected = self._readout(features).squeeze(-1)  # (T, N)
        error = ((torch.from_numpy(returns) - expected) * torch.from_numpy(mask)).square().sum()
        return expected.detach().numpy(), self._weight * error

    @override
    def parameters(self) -> list[nn.Parameter]:
        return list(self._readout.parameters())

    @override
    def state_dict(self) -> dict[str, Any]:
        return self._readout.state_dict()

    @override
    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._readout.load_state_dict(state)


class HistoryBaseline(Baseline):
    """b(h_t) is what a second LSTM expects, which sees the same history as the policy (section 3.3.2).

    It is trained by supervised regression on the returns actually received, never by bootstrapping, so no assumption
    about hidden states enters. Returns are scaled by their running mean and deviation, so that one step size does for
    all tasks.

    Args:
        observation_size: Length O of an observation.
        head: The policy's, which says how an action is shown.
        hidden_size: Cells.
        optimizer: Name of a class in ``torch.optim``.
        learning_rate: Its step size.
        optimizer_options: Its other arguments.
        steps: Gradient steps a batch.
        seed: Of the initial weights.
    """

    def __init__(
        self,
        observation_size: int,
        head: Head,
        *,
        hidden_size: int = 10,
        optimizer: str = "SGD",
        learning_rate: float = 0.001,
        optimizer_options: dict[str, Any] | None = None,
        steps: int = 1,
        seed: int = 0,
    ) -> None:
        self._head = head
        self._steps = steps
        self._core = nn.LSTM(observation_size + head.echo_size, hidden_size)
        self._readout = nn.Linear(hidden_size, 1)
        generator = torch.Generator().manual_seed(seed)
        for parameter in (*self._core.parameters(), *self._readout.parameters()):
            nn.init.uniform_(parameter, -0.1, 0.1, generator=generator)
        self._net = nn.ModuleList([self._core, self._readout])
        self._optimizer = make_optimizer(optimizer, self._net.parameters(), learning_rate, optimizer_options or {})
        self._mean, self._deviation = 0.0, 0.0  # of the returns; a deviation of 0 says that none were seen
        self.explained_variance = float("nan")

    @override
    def __call__(
        self, episodes: Episodes, features: Tensor, returns: NDArray[np.float32], mask: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float32], None]:
        expected = self.expected(episodes)
        spread = float(returns[mask].var())
        self.explained_variance = 1.0 - float((returns - expected)[mask].var()) / spread if spread > 0.0 else 0.0
        self.learn(episodes, returns, mask)
        return expected, None

    def expected(self, episodes: Episodes) -> NDArray[np.float32]:
        """What it expects at each step, ``(T, N)``."""
        with torch.no_grad():
            expected: NDArray[np.float32] = self._forward(self._inputs(episodes)).numpy()
        return self._mean + self._deviation * expected

    def learn(self, episodes: Episodes, returns: NDArray[np.float32], mask: NDArray[np.bool_]) -> None:
        """Go towards the returns that were received."""
        mean, deviation = float(returns[mask].mean()), float(returns[mask].std())
        memory = 0.9 if self._deviation > 0.0 else 0.0
        self._mean = memory * self._mean + (1.0 - memory) * mean
        self._deviation = max(memory * self._deviation + (1.0 - memory) * deviation, 1e-8)
        inputs = self._inputs(episodes)
        targets = torch.from_numpy((returns - np.float32(self._mean)) / np.float32(self._deviation))
        weights = torch.from_numpy(mask.astype(np.float32) / mask.sum())
        for _ in range(self._steps):
            self._optimizer.zero_grad()
            ((self._forward(inputs) - targets).square() * weights).sum().backward()
            self._optimizer.step()

    def _inputs(self, episodes: Episodes) -> Tensor:
        """Observations and previous actions, ``(T, N, O + echo)``."""
        observations, actions = torch.from_numpy(episodes.observations), torch.from_numpy(episodes.actions)
        echoes = self._head.echo(actions).roll(1, 0)
        echoes[0] = 0
        return torch.cat((observations, echoes.float()), -1)

    def _forward(self, inputs: Tensor) -> Tensor:
        features, _ = self._core(inputs)
        expected: Tensor = self._readout(features).squeeze(-1)
        return expected

    @override
    def state_dict(self) -> dict[str, Any]:
        return {
            "net": self._net.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "returns": [self._mean, self._deviation],
        }

    @override
    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._net.load_state_dict(state["net"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._mean, self._deviation = state["returns"]
