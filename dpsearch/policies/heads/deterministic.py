"""The deterministic head, for continuous actions found by black-box search."""

from __future__ import annotations

import torch
from torch import Tensor
from typing_extensions import override

from dpsearch.kernels.activations import tanh
from dpsearch.kernels.lanes import FASTMATH, Compiled
from dpsearch.kernels.on_demand import on_demand
from dpsearch.policies.heads.base import Head


@on_demand(fastmath=FASTMATH)
def squashed(sizes, noise, output, action, lanes):
    """The outputs, squashed by tanh."""
    for i in range(sizes[0]):
        for lane in range(lanes):
            action[i, lane] = tanh(output[i, lane])


@on_demand()
def unsquashed(sizes, noise, output, action, lanes):
    """The outputs as they are."""
    action[:] = output[: sizes[0]]


class Deterministic(Head):
    """The action is the outputs, squashed by tanh: for black-box search, which needs no probabilities.

    Args:
        size: Dimension of the action, each in (-1, 1).
        squash: False leaves tanh away, where the outputs are activations already.
    """

    def __init__(self, size: int, *, squash: bool = True) -> None:
        if size < 1:
            raise ValueError(f"a deterministic head needs at least one action dimension, got {size}")
        self.squash = squash
        self.n_outputs = size
        self.action_size = size
        self.draws = 0
        self.layout = (size,)

    @property
    @override
    def compiled_sample(self) -> Compiled:
        return squashed if self.squash else unsquashed

    @property
    @override
    def compiled_mode(self) -> Compiled:
        return self.compiled_sample

    @override
    def log_prob(self, outputs: Tensor, actions: Tensor) -> Tensor:
        raise TypeError("a deterministic head has no log-probabilities: use it with a black-box search")

    @override
    def entropy(self, outputs: Tensor) -> Tensor:
        raise TypeError("a deterministic head has no entropy: use it with a black-box search")

    @override
    def cross_entropy(self, before: Tensor, outputs: Tensor) -> Tensor:
        raise TypeError("a deterministic head has no entropy: use it with a black-box search")

    @override
    def sample(self, outputs: Tensor, uniforms: Tensor) -> Tensor:
        return self.mode(outputs)

    @override
    def mode(self, outputs: Tensor) -> Tensor:
        return torch.tanh(outputs) if self.squash else outputs
