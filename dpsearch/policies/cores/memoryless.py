"""A layer of tanh units without memory: a policy that reacts to what it sees at this step, and to nothing else.

h = tanh(W v)    v = (inputs, 1)
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
from dpsearch.policies.cores.stacking import NOISE, UNITS, read_out, stack, stacked_rows


@on_demand(fastmath=FASTMATH)
def memoryless_step(sizes, weights, observation, hidden, scratch, output, lanes):
    """One step of ``Memoryless`` and the read-out; ``hidden`` holds noise and previous action alone."""
    n, rows = sizes[UNITS], stacked_rows(sizes)
    seen, units = scratch[:rows], scratch[rows:]
    columns = stack(sizes, observation, hidden[sizes[NOISE] :], hidden, 0, seen)
    matvec(weights, 0, n, columns, seen, units, lanes)
    for j in range(n):
        for lane in range(lanes):
            units[j, lane] = tanh(units[j, lane])
    read_out(sizes, weights, n * columns, units, hidden, seen, output, lanes)


class Memoryless(Core):
    """``torch.nn.Linear`` and tanh. If the policy sees its previous action, that is an input."""

    words = "no memory, {} units"
    workspace = 1
    step = staticmethod(memoryless_step)

    @override
    def forward(self, inputs: Tensor, before: Sequence[Tensor]) -> tuple[Tensor, tuple[Tensor, ...]]:
        return torch.tanh(torch.nn.functional.linear(inputs, self.weight_ih, self.bias)), ()
