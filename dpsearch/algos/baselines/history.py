"""The history baseline: b(h_t) is predicted by a second LSTM, beside the policy (section 3.3.2).

It is trained by supervised regression on the returns actually received, never by bootstrapping, so no assumption about
hidden states enters. Returns are scaled by their running mean and deviation: one step size does for all tasks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from typing_extensions import override

from dpsearch.algos.baselines.base import Baseline, BaselineConfig, Counted
from dpsearch.algos.optimizers import OPTIMIZERS, make_optimizer
from dpsearch.algos.settings import is_number, is_whole, require
from dpsearch.policies import RecurrentPolicy
from dpsearch.policies.buckets import run_in_buckets
from dpsearch.rollout import Episodes, Pieces

SCALE_MEMORY = 0.9  # decay of the returns' running mean and mean square, from batch to batch
LEAST = 1e-6  # least deviation, as a part of the mean: below is rounding


@dataclass(frozen=True)
class HistoryConfig(BaselineConfig):
    """Settings of the history baseline.

    Attributes:
        cells: Cells of the LSTM (thesis: 10).
        optimizer: Name of a class in ``torch.optim``, one of ``OPTIMIZERS``.
        learning_rate: Step size of the optimiser, for the squared error averaged over steps, of returns scaled to
            deviation 1.
        optimizer_options: Other arguments of the optimiser, such as ``{momentum: 0.9}``.
        steps: Gradient steps after every batch.
    """

    kind: str = field(default="history", init=False)
    cells: int = 10
    optimizer: str = "Adam"
    learning_rate: float = 0.01
    optimizer_options: dict[str, Any] = field(default_factory=dict)
    steps: int = 1

    def __post_init__(self) -> None:
        """Raise a ValueError that names the setting if a value is out of range."""
        require(
            self,
            {
                "cells": (is_whole(self.cells, 1), "a whole number, at least 1"),
                "optimizer": (self.optimizer in OPTIMIZERS, f"one of {', '.join(OPTIMIZERS)}"),
                "learning_rate": (is_number(self.learning_rate) and self.learning_rate > 0.0, "positive and finite"),
                "optimizer_options": (isinstance(self.optimizer_options, dict), "a mapping of the optimiser's options"),
                "steps": (is_whole(self.steps, 1), "a whole number, at least 1"),
            },
        )


class HistoryBaseline(Baseline):
    """b(h_t) is predicted by a second LSTM that sees the same history as the policy."""

    config_type = HistoryConfig

    def __init__(self, config: HistoryConfig, policy: RecurrentPolicy, seed: int) -> None:
        self._head = policy.head
        self._steps = config.steps
        self._core = nn.LSTM(policy.observation_size + policy.head.echo_size, config.cells)
        self._readout = nn.Linear(config.cells, 1)
        generator = torch.Generator().manual_seed(seed)
        for parameter in (*self._core.parameters(), *self._readout.parameters()):
            nn.init.uniform_(parameter, -0.1, 0.1, generator=generator)
        self._net = nn.ModuleList([self._core, self._readout])
        self._optimizer = make_optimizer(
            config.optimizer, self._net.parameters(), config.learning_rate, config.optimizer_options
        )
        self._mean, self._square, self._deviation = 0.0, 0.0, 0.0  # of the returns; a deviation of 0: none were seen
        self._carried = torch.zeros(0)  # h, c and the previous action at the end of the last piece of a stream

    @override
    def __call__(
        self, episodes: Episodes, features: Tensor, returns: NDArray[np.float32], counted: Counted = None
    ) -> tuple[NDArray[np.float32], None]:
        mask = episodes.mask if counted is None else counted
        inputs, lengths, state = self._inputs(episodes), episodes.seen, self._state(episodes)
        expected = self._forward(inputs, lengths, state)  # serves twice: as the baseline, and to learn from
        foreseen: NDArray[np.float32] = expected.detach().numpy()
        baseline = np.float32(self._mean) + np.float32(self._deviation) * foreseen
        self._remember_scale(returns[mask])
        targets = torch.from_numpy((returns - np.float32(self._mean)) / np.float32(self._deviation))
        weights = torch.from_numpy(mask.astype(np.float32) / mask.sum())
        for step in range(self._steps):
            if step > 0:
                expected = self._forward(inputs, lengths, state)
            for parameter in self._net.parameters():
                parameter.grad = None
            ((expected - targets).square() * weights).sum().backward()
            if not all(bool(p.grad.isfinite().all()) for p in self._net.parameters() if p.grad is not None):
                break  # a gradient that exploded through thousands of steps would leave no weight finite
            self._optimizer.step()
        if isinstance(episodes, Pieces):
            self._carry(episodes, inputs, state)
        return baseline, None

    @override
    def expected(self, episodes: Episodes, features: Tensor | None = None) -> NDArray[np.float32]:
        with torch.no_grad():
            expected: NDArray[np.float32] = self._forward(
                self._inputs(episodes), episodes.seen, self._state(episodes)
            ).numpy()
        return np.float32(self._mean) + np.float32(self._deviation) * expected

    def _remember_scale(self, returns: NDArray[np.float32]) -> None:
        """Update the running mean and deviation with the returns ``(M,)`` of a batch."""
        memory = SCALE_MEMORY if self._deviation > 0.0 else 0.0
        received = returns.astype(np.float64)
        self._mean = memory * self._mean + (1.0 - memory) * float(received.mean())
        self._square = memory * self._square + (1.0 - memory) * float(np.square(received).mean())
        variance = max(self._square - self._mean**2, 0.0)  # within batches, and between them
        self._deviation = max(math.sqrt(variance), LEAST * abs(self._mean), 1e-8)

    def _inputs(self, episodes: Episodes) -> Tensor:
        """Observations and previous actions, ``(T, N, O + echo)``."""
        observations, actions = torch.from_numpy(episodes.observations), torch.from_numpy(episodes.actions)
        echoes = self._head.echo(actions).roll(1, 0)
        echoes[0] = 0
        if self._goes_on(episodes):
            echoes[0, 0] = self._carried[2 * self._core.hidden_size :]
        return torch.cat((observations, echoes.float()), -1)

    def _goes_on(self, episodes: Episodes) -> bool:
        """Whether the first piece continues the episode in which the last batch ended."""
        return isinstance(episodes, Pieces) and not episodes.begins and len(self._carried) > 0

    def _state(self, episodes: Episodes) -> tuple[Tensor, Tensor] | None:
        """The LSTM's h and c before the first step, ``(1, N, H)`` each; None for whole episodes."""
        if not isinstance(episodes, Pieces):
            return None
        n = self._core.hidden_size
        h, c = torch.zeros(2, 1, len(episodes), n)
        if self._goes_on(episodes):
            h[0, 0], c[0, 0] = self._carried[:n], self._carried[n : 2 * n]
        return h, c

    def _carry(self, pieces: Pieces, inputs: Tensor, state: tuple[Tensor, Tensor] | None) -> None:
        """Remember h, c and the action at the end of the last piece."""
        assert state is not None
        length = int(pieces.lengths[-1])
        with torch.no_grad():
            before = (state[0][:, -1:].contiguous(), state[1][:, -1:].contiguous())
            _, (h, c) = self._core(inputs[:length, -1:], before)
            echo = self._head.echo(torch.from_numpy(pieces.actions[length - 1, -1:]))
        self._carried = torch.cat((h[0, 0], c[0, 0], echo[0].float()))

    def _forward(
        self, inputs: Tensor, lengths: NDArray[np.int64], state: tuple[Tensor, Tensor] | None = None
    ) -> Tensor:
        if state is None:
            features = run_in_buckets(lambda part: self._core(part)[0], inputs, lengths)
        else:
            features, _ = self._core(inputs, state)
        expected: Tensor = self._readout(features).squeeze(-1)
        return expected

    @override
    def state_dict(self) -> dict[str, Any]:
        return {
            "net": self._net.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "returns": [self._mean, self._square, self._deviation],
            "carried": self._carried,
        }

    @override
    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._net.load_state_dict(state["net"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._mean, self._square, self._deviation = state["returns"]
        self._carried = state["carried"]
