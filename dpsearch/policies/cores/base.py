"""The base class of cores: the part of a policy that turns its history into features, in torch and compiled.

The two twins must agree to rounding, so they stand side by side in one file for each core. A new core is a new file and
an entry in ``CORES``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from dpsearch.kernels.lanes import Compiled


class Core(nn.Module, ABC):
    """Features ``(T, B, H)`` of the inputs ``(T, B, I)`` of whole episodes, with or without a memory.

    Its parameters are those of ``torch.nn.LSTM`` and its like, except that no parameter is redundant: where torch adds
    two bias vectors, there is one.

    Args:
        inputs: I, the numbers that are seen at each step.
        units: H, the features.
        bias: Whether there are biases.

    Attributes:
        words: Name of the core in tables of results; ``{}`` stands for H.
        blocks: Weight matrices of H rows that torch stacks: the gates, and what is written into the memory.
        states: Numbers of recurrent state for each unit.
        workspace: Rows of working memory for each unit, beside the inputs, that ``step`` needs.
        gate_biases: Settings that are added to the initial biases of a gate, and the gate's place among the blocks.
        step: The compiled twin: one step in many lanes, with the read-out. Signatures ``FORWARD_SHARED``,
            ``FORWARD_LANES`` and ``FORWARD_SINGLE``; compiled on demand.
    """

    words: ClassVar[str]
    blocks: ClassVar[int] = 1
    states: ClassVar[int] = 0
    workspace: ClassVar[int] = 0
    gate_biases: ClassVar[Mapping[str, int]] = {}
    step: ClassVar[Compiled]

    weight_ih: nn.Parameter  # (blocks H, I)
    weight_hh: nn.Parameter  # (blocks H, H), if there is a memory
    bias: nn.Parameter | None  # (blocks H,)

    def __init__(self, inputs: int, units: int, bias: bool) -> None:
        super().__init__()
        self.units = units
        rows = self.blocks * units
        self.weight_ih = nn.Parameter(torch.empty(rows, inputs))
        if self.states:
            self.weight_hh = nn.Parameter(torch.empty(rows, units))
        self.register_parameter("bias", nn.Parameter(torch.empty(rows)) if bias else None)

    @abstractmethod
    def forward(self, inputs: Tensor, before: Sequence[Tensor]) -> tuple[Tensor, tuple[Tensor, ...]]:
        """The features of whole episodes.

        Args:
            inputs: ``(T, B, I)``, one episode a column.
            before: Recurrent state before the first step: ``states`` tensors ``(1, B, H)``.

        Returns:
            Features ``(T, B, H)``, and the recurrent state after the last step, in the form of ``before``.
        """

    @property
    def state_size(self) -> int:
        """Numbers of recurrent state that an episode carries."""
        return self.states * self.units

    def start(self, inputs: Tensor, state: Tensor | None = None) -> tuple[Tensor, ...]:
        """Recurrent state ``(B, state_size)`` as ``forward`` takes it; zeros, to fit the inputs, if None."""
        if state is None:
            return (inputs.new_zeros(1, inputs.shape[1], self.units),) * self.states
        return tuple(part.contiguous() for part in state[None].split(self.units, -1)) if self.states else ()

    def initialise(self, generator: torch.Generator, init_range: float, added: Mapping[str, float]) -> None:
        """Draw all parameters uniformly from ``[-init_range, init_range]``.

        Args:
            generator: Source of the random numbers.
            init_range: Half the width of the distribution.
            added: Numbers to add to the biases of gates, by the names in ``gate_biases``.
        """
        for parameter in self.parameters():
            nn.init.uniform_(parameter, -init_range, init_range, generator=generator)
        if self.bias is not None:
            with torch.no_grad():
                for name, block in self.gate_biases.items():
                    self.bias[block * self.units : (block + 1) * self.units] += added[name]

    def torch_weights(self) -> list[Tensor]:
        """The weights as torch's fused functions take them: two matrices, and two bias vectors if there are biases."""
        matrices: list[Tensor] = [self.weight_ih, self.weight_hh]
        return matrices if self.bias is None else [*matrices, self.bias, self.second_bias()]

    def second_bias(self) -> Tensor:
        """The bias vector that torch adds to the recurrent part, where a core has no use for it: zeros."""
        return torch.zeros_like(self.weight_ih[:, 0])

    def places(self) -> dict[str, NDArray[np.intp]]:
        """Indices of each parameter, in its shape, in a policy's flat vector, which begins with the core's."""
        found, first = {}, 0
        for name, parameter in self.named_parameters():
            found[name] = np.arange(first, first + parameter.numel()).reshape(parameter.shape)
            first += parameter.numel()
        return found

    def packed(self) -> list[NDArray[np.intp]]:
        """The matrices that ``step`` reads, one after the other, as places in the vector: here (W_ih, W_hh, bias)."""
        return [np.hstack([part.reshape(len(part), -1) for part in self.places().values()])]
