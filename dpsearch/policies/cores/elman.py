"""Elman's recurrent network: tanh units that see their own previous activations (Elman, 1990).

h' = tanh(W v)    v = (inputs, h, 1)
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from typing_extensions import override

from dpsearch.kernels.activations import tanh
from dpsearch.kernels.lanes import FASTMATH
from dpsearch.kernels.matvec import matvec
from dpsearch.kernels.on_demand import on_demand
from dpsearch.policies.cores.base import Core
from dpsearch.policies.cores.stacking import NOISE, UNITS, read_out, stack


@on_demand(fastmath=FASTMATH)
def elman_step(sizes, weights, observation, hidden, scratch, output, lanes):
    """One step of ``Elman`` and the read-out; ``hidden`` holds h, then noise and previous action."""
    n, noise = sizes[UNITS], hidden[sizes[UNITS] :]
    columns = stack(sizes, observation, noise[sizes[NOISE] :], hidden, n, scratch)
    matvec(weights, 0, n, columns, scratch, hidden, lanes)
    for j in range(n):
        for lane in range(lanes):
            hidden[j, lane] = tanh(hidden[j, lane])
    read_out(sizes, weights, n * columns, hidden, noise, scratch, output, lanes)


class Elman(Core):
    """``torch.nn.RNN`` with tanh, whose second bias vector is redundant and left out."""

    words = "Elman, {} units"
    states = 1
    step = staticmethod(elman_step)

    @override
    def forward(self, inputs: Tensor, before: Sequence[Tensor]) -> tuple[Tensor, tuple[Tensor, ...]]:
        weights, biased = self.torch_weights(), self.bias is not None
        # the last arguments: layers, dropout, training, bidirectional, batch first
        features, h = torch.rnn_tanh(inputs, before[0], weights, biased, 1, 0.0, False, False, False)
        return features, (h,)
