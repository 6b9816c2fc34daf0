"""Action heads: how the outputs of a network are read as a distribution over actions.

A head has no parameters. It says how many outputs the network needs and turns them into actions, log-probabilities,
eligibilities and entropies. Sampling maps given uniform numbers to actions by inverting the distribution, in torch
here and in compiled code in ``compiled.py``, so that keyed randomness gives the same action on every engine.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from typing_extensions import override

from dpsearch.policies.eligibilities import softmax_eligibilities, softmax_gradient

LOG_SQRT_2PI = 0.5 * math.log(2.0 * math.pi)
_NO_BONUS = np.empty((0, 0), np.float32)


def _rows(numbers: NDArray[Any], *width: int) -> NDArray[np.float32]:
    """Numbers ``(..)`` as ``(M, width)``, or ``(M,)``; of the same memory if they are float32 and contiguous."""
    return np.ascontiguousarray(numbers, np.float32).reshape(-1, *width)


class Head(ABC):
    """A distribution over actions, parametrised by a network's outputs ``(..., n_outputs)``.

    Attributes:
        n_outputs: How many numbers the network has to give.
        action_size: Numbers in one action; actions are ``(..., action_size)``.
        draws: Uniform numbers that sampling one action uses up; 0 for a head that does not sample.
        has_variance: Whether the actions have a variance, by which eligibilities can be scaled.
        is_discrete: Whether the actions are choices, which have probabilities.
    """

    n_outputs: int
    action_size: int
    draws: int
    has_variance: ClassVar[bool] = False
    is_discrete: ClassVar[bool] = False

    @property
    def echo_size(self) -> int:
        """Numbers that tell a policy what its previous action was."""
        return self.action_size

    def echo(self, actions: Tensor) -> Tensor:
        """Actions ``(..., action_size)`` as an input ``(..., echo_size)``: as they are, or one-hot if discrete."""
        return actions

    @abstractmethod
    def log_prob(self, outputs: Tensor, actions: Tensor) -> Tensor:
        """Log pi(a|h) ``(...)`` of actions ``(..., action_size)``."""

    @abstractmethod
    def entropy(self, outputs: Tensor) -> Tensor:
        """The entropy of pi(.|h) in nats, ``(...)``."""

    @abstractmethod
    def sample(self, outputs: Tensor, uniforms: Tensor) -> Tensor:
        """The actions ``(..., action_size)`` that the uniform numbers ``(..., draws)`` in (0, 1) pick."""

    @abstractmethod
    def mode(self, outputs: Tensor) -> Tensor:
        """The most probable actions ``(..., action_size)``: what the greedy policy does."""

    @abstractmethod
    def cross_entropy(self, before: Tensor, outputs: Tensor) -> Tensor:
        """Minus the mean log pi(a|h) of actions that other outputs ``before`` would pick, in nats, ``(...)``."""

    def imitation_loss(
        self, actions: Tensor, weights: Tensor, before: Tensor, known: Tensor
    ) -> Callable[[Tensor], Tensor]:
        """How far outputs are from doing what was done, by weight, of which a part goes to what might have been done.

        Args:
            actions: Those taken, ``(..., action_size)``.
            weights: How much each step counts, ``(...)``.
            before: What the outputs were when they were taken, ``(..., n_outputs)``.
            known: The part of the weights that goes to all actions by their probabilities, ``(...)``.

        Returns:
            What makes, of outputs ``(..., n_outputs)``, the loss ``(...)``, in nats.
        """
        sampled = weights - known
        if not known.any():
            return lambda outputs: -sampled * self.log_prob(outputs, actions)
        return lambda outputs: known * self.cross_entropy(before, outputs) - sampled * self.log_prob(outputs, actions)

    def eligibilities(
        self, outputs: Tensor, actions: Tensor, weights: Tensor, bonus: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """What each output has to do with the actions taken, and the entropy, which mostly comes for free.

        Args:
            outputs: ``(..., n_outputs)``.
            actions: ``(..., action_size)``.
            weights: ``(...)``, that each step's eligibilities are multiplied by.
            bonus: ``(...)``, by which the derivatives of the entropy are multiplied and then added; None for none.

        Returns:
            The derivatives of log pi(a|h) by the outputs, weighted, ``(..., n_outputs)``, and the entropy ``(...)``.
        """
        outputs = outputs.detach().requires_grad_()
        entropy = self.entropy(outputs)
        gain = (self.log_prob(outputs, actions) * weights).sum()
        if bonus is not None:
            gain = gain + (entropy * bonus).sum()
        (eligibilities,) = torch.autograd.grad(gain, outputs)
        return eligibilities, entropy.detach()

    def scaled_eligibilities(
        self, outputs: Tensor, actions: Tensor, weights: Tensor, bonus: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """The same times the variance sigma^2 of each dimension (Williams 1992): finite as sigma goes to 0.

        Raises:
            TypeError: If the distribution is not Gaussian.
        """
        raise TypeError(f"variance_scaled needs a Gaussian policy, this one's head is {type(self).__name__}")

    def fisher(self, outputs: Tensor, changes: Tensor) -> Tensor:
        """The Fisher information of the distribution over actions, times some changes of its parameters.

        Args:
            outputs: ``(..., n_outputs)``.
            changes: ``(..., n_outputs)``.

        Returns:
            ``(..., n_outputs)``; half its product with ``changes`` is, to second order, the KL divergence of the
            changed distribution.

        Raises:
            TypeError: If the head has no distribution.
        """
        raise TypeError(f"{type(self).__name__} has no distribution over actions")

    def squared_error(self, outputs: Tensor, actions: Tensor) -> Tensor:
        """Squared distance ``(...)`` of the probabilities from those of who takes these actions for certain.

        Raises:
            TypeError: If actions are not discrete.
        """
        raise TypeError(f"loss=squared needs discrete actions, this policy's head is {type(self).__name__}")


class Categorical(Head):
    """Softmax over discrete actions (section 3.4.2); several independent ones for a MultiDiscrete space.

    Args:
        sizes: The number of choices of each discrete action.
    """

    is_discrete = True

    def __init__(self, sizes: Sequence[int]) -> None:
        if not sizes or min(sizes) < 1:
            raise ValueError(f"a categorical head needs one positive size or more, got {tuple(sizes)}")
        self.sizes = tuple(int(n) for n in sizes)
        self.n_outputs = sum(self.sizes)
        self.action_size = len(self.sizes)
        self.draws = len(self.sizes)
        self._sizes = np.array(self.sizes, np.int64)

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
        """Log p of each group's choices, choices first: torch vectorises over all but a short last axis."""
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


class Gaussian(Head):
    """Independent Gaussians with linear mean and sigmoid standard deviation (section 3.4.1).

    The outputs are the ``size`` means followed by the ``size`` raw standard deviations.

    Args:
        size: Dimension of the action.
    """

    has_variance = True

    def __init__(self, size: int) -> None:
        if size < 1:
            raise ValueError(f"a Gaussian head needs at least one action dimension, got {size}")
        self.size = size
        self.n_outputs = 2 * size
        self.action_size = size
        self.draws = 2 * size

    def _mean_and_std(self, outputs: Tensor) -> tuple[Tensor, Tensor]:
        return outputs[..., : self.size], torch.sigmoid(outputs[..., self.size :])

    @override
    def log_prob(self, outputs: Tensor, actions: Tensor) -> Tensor:
        mean, std = self._mean_and_std(outputs)
        log_std = torch.nn.functional.logsigmoid(outputs[..., self.size :])
        return (-0.5 * ((actions - mean) / std) ** 2 - log_std - LOG_SQRT_2PI).sum(-1)

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
        return (log_std + 0.5 + LOG_SQRT_2PI).sum(-1)

    @override
    def cross_entropy(self, before: Tensor, outputs: Tensor) -> Tensor:
        mean, std = self._mean_and_std(outputs)
        mean_before, std_before = self._mean_and_std(before)
        log_std = torch.nn.functional.logsigmoid(outputs[..., self.size :])
        squares = std_before.square() + (mean_before - mean).square()
        return (0.5 * squares / std.square() + log_std + LOG_SQRT_2PI).sum(-1)

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


class Deterministic(Head):
    """The outputs, squashed by tanh, are the action: for black-box search, which needs no probabilities.

    Args:
        size: Dimension of the action, each in (-1, 1).
        squash: False takes the outputs as they are, if they are activations already.
    """

    def __init__(self, size: int, *, squash: bool = True) -> None:
        if size < 1:
            raise ValueError(f"a deterministic head needs at least one action dimension, got {size}")
        self.squash = squash
        self.n_outputs = size
        self.action_size = size
        self.draws = 0

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
