"""Action heads: how the outputs of a network are read as a distribution over actions.

A head has no parameters. It says how many outputs the network needs and turns them into actions, log-probabilities,
eligibilities and entropies. Sampling maps given uniform numbers to actions by inverting the distribution, in torch and
in a compiled twin that stands in the same file, so that keyed randomness gives the same action on every engine.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

import torch
from torch import Tensor

from dpsearch.kernels.lanes import Compiled


class Head(ABC):
    """A distribution over actions, parametrised by a network's outputs ``(..., n_outputs)``.

    Attributes:
        n_outputs: Numbers that the network has to give.
        action_size: Numbers in one action; actions are ``(..., action_size)``.
        draws: Uniform numbers that sampling one action uses up.
        layout: Sizes that the compiled twins need to find their way among the outputs.
        deviations: How many of the last outputs are standard deviations before their sigmoid.
        one_hot: Whether a policy sees its previous action one-hot, as choices of ``layout``.
    """

    n_outputs: int
    action_size: int
    draws: int
    layout: tuple[int, ...]
    deviations: int = 0
    one_hot: ClassVar[bool] = False

    @property
    @abstractmethod
    def compiled_sample(self) -> Compiled:
        """Compiled twin of ``sample``. Signature ``SAMPLE``; compiled on demand."""

    @property
    @abstractmethod
    def compiled_mode(self) -> Compiled:
        """Compiled twin of ``mode``. Signature ``SAMPLE``; compiled on demand."""

    @property
    def echo_size(self) -> int:
        """Numbers that tell a policy its previous action."""
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
        """The most probable actions ``(..., action_size)``, which the greedy policy takes."""

    @abstractmethod
    def cross_entropy(self, before: Tensor, outputs: Tensor) -> Tensor:
        """Cross-entropy ``(...)`` in nats: minus the mean of log pi(a|h) over the actions that ``before`` would pick.

        Args:
            before: Other outputs ``(..., n_outputs)``, whose distribution the mean is taken over.
            outputs: ``(..., n_outputs)``, whose log-probabilities are averaged.
        """

    def imitation_loss(
        self, actions: Tensor, weights: Tensor, before: Tensor, known: Tensor
    ) -> Callable[[Tensor], Tensor]:
        """Weighted negative log-likelihood of the actions taken.

        The part ``known`` of each weight goes to all possible actions instead, by the probabilities that they had. Its
        share of the loss has a closed form, the cross-entropy.

        Args:
            actions: Actions taken, ``(..., action_size)``.
            weights: Weight of each step, ``(...)``.
            before: The outputs with which the actions were taken, ``(..., n_outputs)``.
            known: Part of the weight that goes to all possible actions, ``(...)``.

        Returns:
            A function from outputs ``(..., n_outputs)`` to the loss ``(...)``, in nats.
        """
        sampled = weights - known
        if not known.any():
            return lambda outputs: -sampled * self.log_prob(outputs, actions)
        return lambda outputs: known * self.cross_entropy(before, outputs) - sampled * self.log_prob(outputs, actions)

    def eligibilities(
        self, outputs: Tensor, actions: Tensor, weights: Tensor, bonus: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Derivatives of log pi(a|h) by the outputs, weighted; also the entropy, which costs little more.

        Args:
            outputs: ``(..., n_outputs)``.
            actions: ``(..., action_size)``.
            weights: Factor ``(...)`` of each step's eligibilities.
            bonus: Factor ``(...)`` of the entropy's derivatives, which are then added; None for none.

        Returns:
            The derivatives ``(..., n_outputs)`` and the entropy ``(...)`` in nats.
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
        """``eligibilities`` times the variance sigma^2 of each dimension: finite as sigma goes to 0 (Williams, 1992).

        Raises:
            TypeError: If the distribution is not Gaussian.
        """
        raise TypeError(f"variance_scaled needs a Gaussian policy, this one's head is {type(self).__name__}")

    def fisher(self, outputs: Tensor, changes: Tensor) -> Tensor:
        """The Fisher information matrix of the distribution over actions, times a change of the outputs.

        Args:
            outputs: ``(..., n_outputs)``.
            changes: ``(..., n_outputs)``.

        Returns:
            The product ``(..., n_outputs)``. Half its inner product with ``changes`` is, to second order, the KL
            divergence between the distributions with and without the change.

        Raises:
            TypeError: If the head has no distribution.
        """
        raise TypeError(f"{type(self).__name__} has no distribution over actions")

    def squared_error(self, outputs: Tensor, actions: Tensor) -> Tensor:
        """Squared distance ``(...)`` between the probabilities and those of a policy sure of the actions taken.

        Raises:
            TypeError: If actions are not discrete.
        """
        raise TypeError(f"loss=squared needs discrete actions, this policy's head is {type(self).__name__}")
