"""The Gaussian head, for continuous actions (section 3.4.1)."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor
from typing_extensions import override

from dpsearch.kernels.activations import sigmoid
from dpsearch.kernels.elementary import log, sincos
from dpsearch.kernels.lanes import FASTMATH, Compiled
from dpsearch.kernels.on_demand import on_demand
from dpsearch.policies.heads.base import Head

_LOG_SQRT_2PI = 0.5 * math.log(2.0 * math.pi)


@on_demand(fastmath=FASTMATH)
def gaussian_sample(sizes, noise, output, action, lanes):
    """Box and Muller's normal numbers, around the linear mean, with the sigmoid standard deviation."""
    n = sizes[0]
    for i in range(n):
        for lane in range(lanes):
            radius = np.sqrt(-2.0 * log(noise[2 * i, lane]))
            _, cosine = sincos(2.0 * np.pi * noise[2 * i + 1, lane])
            action[i, lane] = output[i, lane] + sigmoid(output[n + i, lane]) * radius * cosine


@on_demand()
def gaussian_mode(sizes, noise, output, action, lanes):
    """The mean."""
    action[:] = output[: sizes[0]]


class Gaussian(Head):
    """Independent Gaussians with linear mean and sigmoid standard deviation (section 3.4.1).

    The outputs are the ``size`` means followed by the ``size`` raw standard deviations.

    Args:
        size: Dimension of the action.
    """

    def __init__(self, size: int) -> None:
        if size < 1:
            raise ValueError(f"a Gaussian head needs at least one action dimension, got {size}")
        self.size = size
        self.n_outputs = 2 * size
        self.action_size = size
        self.draws = 2 * size
        self.layout = (size,)
        self.deviations = size

    @property
    @override
    def compiled_sample(self) -> Compiled:
        return gaussian_sample

    @property
    @override
    def compiled_mode(self) -> Compiled:
        return gaussian_mode

    def _mean_and_std(self, outputs: Tensor) -> tuple[Tensor, Tensor]:
        return outputs[..., : self.size], torch.sigmoid(outputs[..., self.size :])

    @override
    def log_prob(self, outputs: Tensor, actions: Tensor) -> Tensor:
        mean, std = self._mean_and_std(outputs)
        log_std = torch.nn.functional.logsigmoid(outputs[..., self.size :])
        return (-0.5 * ((actions - mean) / std) ** 2 - log_std - _LOG_SQRT_2PI).sum(-1)

    @override
    def scaled_eligibilities(
        self, outputs: Tensor, actions: Tensor, weights: Tensor, bonus: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        mean, std = self._mean_and_std(outputs.detach())
        of_mean = actions - mean
        of_raw_std = (of_mean.square() - std.square()) * (1.0 - std)  # 1 - std: from the slope of the sigmoid
        eligibilities = torch.cat((of_mean, of_raw_std), -1) * weights[..., None]
        if bonus is not None:
            eligibilities[..., self.size :] += std.square() * (1.0 - std) * bonus[..., None]
        return eligibilities, self.entropy(outputs.detach())

    @override
    def entropy(self, outputs: Tensor) -> Tensor:
        log_std = torch.nn.functional.logsigmoid(outputs[..., self.size :])
        return (log_std + 0.5 + _LOG_SQRT_2PI).sum(-1)

    @override
    def cross_entropy(self, before: Tensor, outputs: Tensor) -> Tensor:
        mean, std = self._mean_and_std(outputs)
        mean_before, std_before = self._mean_and_std(before)
        log_std = torch.nn.functional.logsigmoid(outputs[..., self.size :])
        squares = std_before.square() + (mean_before - mean).square()
        return (0.5 * squares / std.square() + log_std + _LOG_SQRT_2PI).sum(-1)

    @override
    def fisher(self, outputs: Tensor, changes: Tensor) -> Tensor:
        _, std = self._mean_and_std(outputs)
        of_mean, of_raw_std = changes.split(self.size, dim=-1)
        return torch.cat((of_mean / std.square(), 2.0 * (1.0 - std).square() * of_raw_std), -1)

    @override
    def sample(self, outputs: Tensor, uniforms: Tensor) -> Tensor:
        mean, std = self._mean_and_std(outputs)
        radius = torch.sqrt(-2.0 * torch.log(uniforms[..., 0::2]))
        normal = radius * torch.cos(2.0 * math.pi * uniforms[..., 1::2])  # Box and Muller
        return mean + std * normal.to(mean.dtype)

    @override
    def mode(self, outputs: Tensor) -> Tensor:
        return outputs[..., : self.size]
