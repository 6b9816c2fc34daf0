"""What return to expect from what was seen and done so far: a second LSTM, beside the policy (section 3.3.2)."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from dpsearch.policies import Head
from dpsearch.rollout import Episodes


class HistoryBaseline:
    """b(h_t) is what a second LSTM expects, which sees the same history as the policy (section 3.3.2).

    It is trained by supervised regression on the returns actually received, never by bootstrapping, so no assumption
    about hidden states enters. Returns are scaled by their running mean and deviation, so that one step size does for
    all tasks.

    Args:
        observation_size: Length O of an observation.
        head: The policy's, which says how an action is shown.
        hidden_size: Cells.
        learning_rate: Step size of its optimiser, Adam.
        steps: Gradient steps a batch.
        seed: Of the initial weights.
    """

    def __init__(
        self,
        observation_size: int,
        head: Head,
        *,
        hidden_size: int = 10,
        learning_rate: float = 0.01,
        steps: int = 5,
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
        self._optimizer = torch.optim.Adam(self._net.parameters(), learning_rate)
        self._mean, self._deviation = 0.0, 0.0  # of the returns; a deviation of 0 says that none were seen

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

    def state_dict(self) -> dict[str, Any]:
        """All that the rest of a run depends on."""
        return {
            "net": self._net.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "returns": [self._mean, self._deviation],
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on where ``state_dict`` was taken."""
        self._net.load_state_dict(state["net"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._mean, self._deviation = state["returns"]
