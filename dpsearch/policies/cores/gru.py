"""Gated recurrent units: an activation that is kept or replaced, as one gate says (Cho et al., EMNLP 2014).

    r, z = sigmoid(W_r v), sigmoid(W_z v)    v = (h, 1, inputs)
    n = tanh(W_n (1, inputs) + r * U_n (h, 1))
    h' = (1 - z) n + z h

The bias in U_n (h, 1) stands inside the reset gate r, so it is not redundant, unlike the other two thirds of torch's
second bias vector.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from typing_extensions import override

from dpsearch.kernels.activations import sigmoid, tanh
from dpsearch.kernels.lanes import FASTMATH
from dpsearch.kernels.matvec import matvec
from dpsearch.kernels.on_demand import on_demand
from dpsearch.policies.cores.base import Core
from dpsearch.policies.cores.stacking import BIAS, NOISE, UNITS, put_inputs, put_with_one, read_out, stacked_rows


@on_demand(fastmath=FASTMATH)
def gru_step(sizes, weights, observation, hidden, scratch, output, lanes):
    """One step of ``GRU`` and the read-out; ``hidden`` holds h, then noise and previous action."""
    n, rows, noise = sizes[UNITS], stacked_rows(sizes), hidden[sizes[UNITS] :]
    seen, gates, units = scratch[:rows], scratch[rows:].reshape(-1), n * lanes
    remembered = put_with_one(hidden, n, sizes[BIAS], seen, 0)  # length of (h, 1)
    columns = put_inputs(sizes, observation, noise[sizes[NOISE] :], seen, remembered)
    fresh = columns - n  # length of (1, inputs), which begins below h
    first = 2 * n * columns
    second = first + n * fresh
    matvec(weights, 0, 2 * n, columns, seen, gates, lanes)
    matvec(weights, first, n, fresh, seen[n:], gates[2 * units :], lanes)
    matvec(weights, second, n, remembered, seen, gates[3 * units :], lanes)
    reset, keep, new, old = gates[:units], gates[units:], gates[2 * units :], gates[3 * units :]  # in torch's order
    for k in range(units):
        new[k] = tanh(new[k] + sigmoid(reset[k]) * old[k])
    for k in range(units):
        keep[k] = sigmoid(keep[k])
    for j in range(n):
        memory, kept, added = hidden[j], keep[j * lanes :], new[j * lanes :]
        for lane in range(lanes):
            added[lane] = added[lane] + kept[lane] * (memory[lane] - added[lane])
        for lane in range(lanes):
            memory[lane] = added[lane]
    read_out(sizes, weights, second + n * remembered, hidden, noise, seen, output, lanes)


class GRU(Core):
    """``torch.nn.GRU`` without its redundant biases: of the second vector the last third alone, ``bias_hn``."""

    words = "GRU, {} units"
    blocks = 3  # reset gate, update gate, new activation
    states = 1
    workspace = 4
    gate_biases = {"forget_bias": 1}  # the update gate z keeps what it is not told to replace
    step = staticmethod(gru_step)

    bias_hn: nn.Parameter | None  # (H,)

    def __init__(self, inputs: int, units: int, bias: bool) -> None:
        super().__init__(inputs, units, bias)
        self.register_parameter("bias_hn", nn.Parameter(torch.empty(units)) if bias else None)

    @override
    def forward(self, inputs: Tensor, before: Sequence[Tensor]) -> tuple[Tensor, tuple[Tensor, ...]]:
        weights, biased = self.torch_weights(), self.bias is not None
        # the last arguments: layers, dropout, training, bidirectional, batch first
        features, h = torch.gru(inputs, before[0], weights, biased, 1, 0.0, False, False, False)
        return features, (h,)

    @override
    def second_bias(self) -> Tensor:
        assert self.bias_hn is not None
        return torch.nn.functional.pad(self.bias_hn, (2 * self.units, 0))

    @override
    def packed(self) -> list[NDArray[np.intp]]:
        places, n = self.places(), 2 * self.units  # the gates have the first n rows
        old, fresh = places["weight_hh"], places["weight_ih"]
        if self.bias is not None:
            fresh = np.column_stack([places["bias"], fresh])
        gates, new, remembered = np.hstack([old, fresh])[:n], fresh[n:], old[n:]
        if self.bias is not None:
            remembered = np.column_stack([remembered, places["bias_hn"]])
        return [gates, new, remembered]
