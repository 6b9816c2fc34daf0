"""Output eligibilities (section 3.3.3): the derivatives of log pi(a_t | h_t) by the outputs, times R_t - b.

Only the outputs are stochastic, so these are the whole of what is particular to reinforcement learning:
backpropagation through time takes them to the weights, as it would errors. For a softmax they are a_i - p_i (section
3.4.2), for a Gaussian (a - mu) / sigma^2 and ((a - mu)^2 - sigma^2) / sigma^3 (section 3.4.1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dpsearch.algos.unroll import outputs_of
from dpsearch.policies import Categorical, RecurrentPolicy
from dpsearch.rollout import Episodes


@dataclass(frozen=True)
class Eligibilities:
    """The place where a gradient enters the graph that leads to the weights: call ``tensors.backward(gradients)``.

    Attributes:
        tensors: The outputs ``(T, N, K)``; or, where a compiled pass has gone through the read-out already, the
            features ``(T, N, H)`` and the read-out's own parameters.
        gradients: Weighted eligibilities at each of the tensors, and of the shape of the tensor.
        entropy: Entropy of pi(.|h_t) in nats, ``(T, N)``.
    """

    tensors: tuple[Tensor, ...]
    gradients: tuple[Tensor, ...]
    entropy: NDArray[np.float32]

    def backward(self, loss: Tensor | None = None) -> None:
        """Backpropagate through time, and add to the weights' ``grad``; another loss too, in the same pass."""
        if loss is None:
            torch.autograd.backward(self.tensors, self.gradients)
        else:
            torch.autograd.backward((*self.tensors, loss), (*self.gradients, None))


def eligibilities(
    policy: RecurrentPolicy,
    episodes: Episodes,
    features: Tensor,
    weights: NDArray[np.float32],
    *,
    bonus: float = 0.0,
    at_outputs: bool = False,
    variance_scaled: bool = False,
) -> Eligibilities:
    """Weighted eligibilities, and the derivatives of an entropy bonus added to them.

    Args:
        policy: The policy that acted.
        episodes: N episodes of up to T steps.
        features: The policy's memory, ``(T, N, H)``, with its graph.
        weights: Weight of the eligibilities of each step, ``(T, N)``; zero on padding.
        bonus: Weight of the entropy of each step.
        at_outputs: Whether the tensor must be the outputs. If False, a softmax's gradient goes through the read-out in
            one compiled pass.
        variance_scaled: Whether to multiply a Gaussian's eligibilities by sigma^2 (section 3.4.1).
    """
    head = policy.head
    bonuses = None if bonus == 0.0 else episodes.mask * np.float32(bonus)  # (T, N)
    if isinstance(head, Categorical) and not at_outputs:
        layer = policy.readout_layer
        *slopes, entropy = head.through_readout(layer, features, episodes.actions, weights, bonuses)
        learns = [
            (tensor, torch.from_numpy(slope))
            for tensor, slope in zip((features, *layer), slopes, strict=True)
            if tensor is not None and tensor.requires_grad
        ]
        return Eligibilities(tuple(t for t, _ in learns), tuple(slope for _, slope in learns), entropy)
    outputs = outputs_of(policy, episodes, features)  # (T, N, K)
    seen = outputs.detach()
    if episodes.padded:  # outputs on padding must not matter
        seen = torch.where(torch.from_numpy(episodes.mask)[..., None], seen, 0.0)
    of_head = head.scaled_eligibilities if variance_scaled else head.eligibilities
    gradient, entropies = of_head(
        seen,
        torch.from_numpy(episodes.actions),
        torch.from_numpy(weights),
        None if bonuses is None else torch.from_numpy(bonuses),
    )
    return Eligibilities((outputs,), (gradient,), entropies.numpy())
