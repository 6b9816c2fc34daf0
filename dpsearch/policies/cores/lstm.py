"""Long short-term memory: cells that keep their content until a gate lets it go (Hochreiter and Schmidhuber, 1997).

i, f, o = sigmoid(W_i v), sigmoid(W_f v), sigmoid(W_o v)    v = (inputs, h, 1)
c' = f c + i tanh(W_g v)
h' = o tanh(c')
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from typing_extensions import override

from dpsearch.kernels.activations import sigmoid, tanh
from dpsearch.kernels.lanes import FASTMATH
from dpsearch.kernels.matvec import matvec
from dpsearch.kernels.on_demand import on_demand
from dpsearch.policies.cores.base import Core
from dpsearch.policies.cores.stacking import NOISE, UNITS, read_out, stack, stacked_rows


@on_demand(fastmath=FASTMATH)
def lstm_step(sizes, weights, observation, hidden, scratch, output, lanes):
    """One step of ``LSTM`` and the read-out; ``hidden`` holds h, then c, then noise and previous action."""
    n, rows, noise = sizes[UNITS], stacked_rows(sizes), hidden[2 * sizes[UNITS] :]
    seen, gates, units = scratch[:rows], scratch[rows:].reshape(-1), n * lanes
    columns = stack(sizes, observation, noise[sizes[NOISE] :], hidden, n, seen)
    matvec(weights, 0, 4 * n, columns, seen, gates, lanes)  # units without gaps: long loops, which is what SIMD likes
    enter, keep, new, leave = gates[:units], gates[units:], gates[2 * units :], gates[3 * units :]  # in torch's order
    for k in range(units):
        new[k] = sigmoid(enter[k]) * tanh(new[k])
    for k in range(units):
        keep[k] = sigmoid(keep[k])
    for j in range(n):
        cell, kept, added = hidden[n + j], keep[j * lanes :], new[j * lanes :]
        for lane in range(lanes):
            added[lane] = kept[lane] * cell[lane] + added[lane]
        for lane in range(lanes):  # assigning slices takes several times as long
            cell[lane] = added[lane]
    for k in range(units):
        leave[k] = sigmoid(leave[k]) * tanh(new[k])
    for j in range(n):
        memory, left = hidden[j], leave[j * lanes :]
        for lane in range(lanes):
            memory[lane] = left[lane]
    read_out(sizes, weights, 4 * n * columns, hidden, noise, seen, output, lanes)


class LSTM(Core):
    """``torch.nn.LSTM``, whose second bias vector is redundant and left out."""

    words = "LSTM, {} cells"
    blocks = 4  # input gate, forget gate, cell, output gate
    states = 2  # h and c
    workspace = 4
    gate_biases = {"input_bias": 0, "forget_bias": 1}
    step = staticmethod(lstm_step)

    @override
    def forward(self, inputs: Tensor, before: Sequence[Tensor]) -> tuple[Tensor, tuple[Tensor, ...]]:
        weights, biased = self.torch_weights(), self.bias is not None
        # the last arguments: layers, dropout, training, bidirectional, batch first
        features, h, c = torch.lstm(inputs, tuple(before), weights, biased, 1, 0.0, False, False, False)
        return features, (h, c)
