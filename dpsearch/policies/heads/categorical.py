"""The softmax head, for discrete actions (section 3.4.2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from typing_extensions import override

from dpsearch.kernels.elementary import exp
from dpsearch.kernels.lanes import FASTMATH, Compiled
from dpsearch.kernels.on_demand import on_demand
from dpsearch.policies.heads.base import Head
from dpsearch.policies.heads.softmax_gradient import softmax_eligibilities, softmax_gradient

_NO_BONUS = np.empty((0, 0), np.float32)


@on_demand(fastmath=FASTMATH)
def categorical_sample(sizes, noise, output, action, lanes):
    """Inverts the cumulative softmax of each group of ``sizes[i]`` outputs. Overwrites ``output``."""
    first = 0
    for i in range(sizes.shape[0]):
        last = first + sizes[i] - 1
        action[i] = output[first]  # the largest logit, for now
        for row in range(first + 1, last + 1):
            for lane in range(lanes):
                action[i, lane] = max(action[i, lane], output[row, lane])
        for lane in range(lanes):
            output[first, lane] = exp(output[first, lane] - action[i, lane])
        for row in range(first + 1, last + 1):
            for lane in range(lanes):
                output[row, lane] = output[row - 1, lane] + exp(output[row, lane] - action[i, lane])
        for lane in range(lanes):
            action[i, lane] = 0.0
        for row in range(first, last):
            for lane in range(lanes):
                action[i, lane] += 1.0 if output[row, lane] <= noise[i, lane] * output[last, lane] else 0.0
        first = last + 1


@on_demand(fastmath=FASTMATH)
def categorical_mode(sizes, noise, output, action, lanes):
    """The first largest output of each group of ``sizes[i]``."""
    first = 0
    for i in range(sizes.shape[0]):
        for lane in range(lanes):
            best = 0
            for choice in range(1, sizes[i]):
                if output[first + choice, lane] > output[first + best, lane]:
                    best = choice
            action[i, lane] = best
        first += sizes[i]


class Categorical(Head):
    """Softmax over discrete actions (section 3.4.2); several independent ones for a MultiDiscrete space.

    Args:
        sizes: The number of choices of each discrete action.
    """

    one_hot = True

    def __init__(self, sizes: Sequence[int]) -> None:
        if not sizes or min(sizes) < 1:
            raise ValueError(f"a categorical head needs one positive size or more, got {tuple(sizes)}")
        self.sizes = tuple(int(n) for n in sizes)
        self.n_outputs = sum(self.sizes)
        self.action_size = len(self.sizes)
        self.draws = len(self.sizes)
        self.layout = self.sizes
        self._sizes = np.array(self.sizes, np.int64)

    @property
    @override
    def compiled_sample(self) -> Compiled:
        return categorical_sample

    @property
    @override
    def compiled_mode(self) -> Compiled:
        return categorical_mode

    @property
    @override
    def echo_size(self) -> int:
        return self.n_outputs

    @override
    def echo(self, actions: Tensor) -> Tensor:
        one_hot = [
            torch.nn.functional.one_hot(a.long(), n) for a, n in zip(actions.unbind(-1), self.sizes, strict=True)
        ]
        return torch.cat(one_hot, -1)

    def _log_softmax(self, outputs: Tensor) -> list[Tensor]:
        """Log-probabilities of each group's choices, choices first: torch vectorises badly over a short last axis."""
        choices_first = outputs.movedim(-1, 0).contiguous()
        return [torch.log_softmax(logits, dim=0) for logits in choices_first.split(self.sizes)]

    @override
    def log_prob(self, outputs: Tensor, actions: Tensor) -> Tensor:
        chosen = actions.movedim(-1, 0).long()
        groups = enumerate(self._log_softmax(outputs))
        return torch.stack([log_p.gather(0, chosen[i : i + 1]).squeeze(0) for i, log_p in groups]).sum(0)

    @override
    def entropy(self, outputs: Tensor) -> Tensor:
        return -torch.stack([(log_p.exp() * log_p).sum(0) for log_p in self._log_softmax(outputs)]).sum(0)

    @override
    def cross_entropy(self, before: Tensor, outputs: Tensor) -> Tensor:
        groups = zip(self._log_softmax(before), self._log_softmax(outputs), strict=True)
        return -torch.stack([(log_q.exp() * log_p).sum(0) for log_q, log_p in groups]).sum(0)

    @override
    def imitation_loss(
        self, actions: Tensor, weights: Tensor, before: Tensor, known: Tensor
    ) -> Callable[[Tensor], Tensor]:
        expected = torch.cat(self._log_softmax(before)).exp_()
        done = self.echo(actions).movedim(-1, 0)
        targets = (weights - known) * done + known * expected  # (K, ...): the loss is linear in them
        return lambda outputs: -(torch.cat(self._log_softmax(outputs)) * targets).sum(0)

    @override
    def squared_error(self, outputs: Tensor, actions: Tensor) -> Tensor:
        chosen = actions.movedim(-1, 0).long()
        errors = []
        for i, log_p in enumerate(self._log_softmax(outputs)):
            p = log_p.exp()
            errors.append(p.square().sum(0) - 2.0 * p.gather(0, chosen[i : i + 1]).squeeze(0) + 1.0)
        return torch.stack(errors).sum(0)

    @override
    def eligibilities(
        self, outputs: Tensor, actions: Tensor, weights: Tensor, bonus: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        if outputs.dtype != torch.float32:
            return super().eligibilities(outputs, actions, weights, bonus)
        eligibilities = np.empty((weights.numel(), self.n_outputs), np.float32)
        entropy = np.empty(weights.numel(), np.float32)
        softmax_eligibilities(
            self._sizes,
            _rows(outputs.detach().numpy(), self.n_outputs),
            _rows(actions.numpy(), self.action_size),
            _rows(weights.numpy()),
            _rows(_NO_BONUS if bonus is None else bonus.numpy()),
            eligibilities,
            entropy,
        )
        return torch.from_numpy(eligibilities).view(outputs.shape), torch.from_numpy(entropy).view(weights.shape)

    def through_readout(
        self,
        layer: tuple[Tensor, Tensor | None],
        features: Tensor,
        actions: NDArray[np.float32],
        weights: NDArray[np.float32],
        bonus: NDArray[np.float32] | None = None,
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """``eligibilities``, backpropagated through the linear layer that makes the outputs, in one compiled pass.

        All arrays are float32 and C-contiguous.

        Args:
            layer: Weights ``(K, H)``, from H features to the K outputs, and bias ``(K,)`` or None.
            features: Input of the layer, ``(T, B, H)``.
            actions: ``(T, B, action_size)``.
            weights: Factor ``(T, B)`` of each step's eligibilities.
            bonus: Factor ``(T, B)`` of the entropy's derivatives, which are then added; None for none.

        Returns:
            The derivatives by the features ``(T, B, H)``, by the weights ``(K, H)`` and by the bias ``(K,)``; and the
            entropy ``(T, B)`` in nats.
        """
        weight = layer[0].detach().numpy()
        bias = np.zeros(len(weight), np.float32) if layer[1] is None else layer[1].detach().numpy()
        by_features, entropy = np.empty(features.shape, np.float32), np.empty(weights.shape, np.float32)
        by_weight, by_bias = np.empty_like(weight), np.empty_like(bias)
        seen = np.ascontiguousarray(features.detach().numpy())
        extra = _NO_BONUS if bonus is None else bonus
        softmax_gradient(
            *(self._sizes, weight, bias, seen, actions, weights, extra, by_features, by_weight, by_bias, entropy)
        )
        return by_features, by_weight, by_bias, entropy

    @override
    def fisher(self, outputs: Tensor, changes: Tensor) -> Tensor:
        parts = []
        for logits, change in zip(outputs.split(self.sizes, dim=-1), changes.split(self.sizes, dim=-1), strict=True):
            probabilities = torch.softmax(logits, dim=-1)
            parts.append(probabilities * (change - (probabilities * change).sum(-1, keepdim=True)))
        return torch.cat(parts, -1)

    @override
    def sample(self, outputs: Tensor, uniforms: Tensor) -> Tensor:
        picks = []
        for i, logits in enumerate(outputs.split(self.sizes, dim=-1)):
            cumulative = torch.softmax(logits.double(), dim=-1).cumsum(-1)
            below = cumulative[..., :-1] <= uniforms[..., i : i + 1]
            picks.append(below.sum(-1))
        return torch.stack(picks, dim=-1)

    @override
    def mode(self, outputs: Tensor) -> Tensor:
        return torch.stack([logits.argmax(-1) for logits in outputs.split(self.sizes, dim=-1)], dim=-1)


def _rows(numbers: NDArray[Any], *width: int) -> NDArray[np.float32]:
    """Numbers ``(..)`` as ``(M, width)``, or ``(M,)``; a view if they are float32 and contiguous."""
    return np.ascontiguousarray(numbers, np.float32).reshape(-1, *width)
