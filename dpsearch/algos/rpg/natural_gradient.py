"""The natural gradient: the direction of steepest ascent where distance is how much the policy's behaviour changes.

    x = (F + damping I)^-1 g,    F = 1/M sum_t J_t^T M_t J_t

J_t are the derivatives of the policy's outputs at step t by its parameters, and M_t is the Fisher information matrix of
its distribution over actions there; so x'F x / 2 is, to second order, the mean KL divergence of a step x (Kakade, NIPS
2001; Martens, JMLR 2020). F is never formed: conjugate gradients need no more than its products with vectors.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import deepcopy

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dpsearch.algos.rpg.gradient import Eligibilities
from dpsearch.algos.unroll import outputs_of, unroll
from dpsearch.policies import RecurrentPolicy
from dpsearch.rollout import Episodes

ITERATIONS = 10  # steps of conjugate gradients: more change little
TOLERANCE = 1e-3  # squared residual at which they end, relative to the gradient's
SHORTENINGS, SLACK = 5, 1.2  # most shortenings; factor by which a step may exceed the divergence asked for
PROBE = 1e-3  # length of the step in parameters whose effect on the outputs is measured


def backpropagate_naturally(
    policy: RecurrentPolicy, episodes: Episodes, eligible: Eligibilities, damping: float, divergence: float
) -> None:
    """Make minus the natural step the ``grad`` of the policy's parameters, for optimisers that descend.

    Args:
        policy: The policy that acted.
        episodes: N episodes of up to T steps, by which the step is judged.
        eligible: Minus the weighted eligibilities, at the outputs.
        damping: Number added to the diagonal of F.
        divergence: Mean KL divergence of the step, in nats.
    """
    parameters = policy.free_parameters()
    minus = torch.autograd.grad(eligible.tensors, parameters, eligible.gradients, retain_graph=True)
    steps = natural_step(
        policy,
        [-part for part in minus],
        eligible.tensors[0],
        lambda probe: outputs_of(probe, episodes, unroll(probe, episodes)),
        episodes.mask,
        damping,
        divergence,
    )
    for parameter, step in zip(parameters, steps, strict=True):
        parameter.grad = -step


def natural_step(
    policy: RecurrentPolicy,
    gradient: list[Tensor],
    outputs: Tensor,
    outputs_with: Callable[[RecurrentPolicy], Tensor],
    mask: NDArray[np.bool_],
    damping: float,
    divergence: float,
) -> list[Tensor]:
    """A step along the natural gradient, found by conjugate gradients.

    Args:
        policy: The policy that acted.
        gradient: The gradient by each of its free parameters.
        outputs: The policy's outputs ``(T, B, n_outputs)``, with the graph that leads to the parameters.
        outputs_with: Function from a policy of the same architecture to its outputs, ``(T, B, n_outputs)``.
        mask: ``(T, B)``, False on padding.
        damping: Number added to F's diagonal.
        divergence: Length of the step: its mean KL divergence in nats, judged by F. Where outputs bend so much that
            the step would come to more, it is shortened.

    Returns:
        The step in each of the free parameters.
    """
    parameters = policy.free_parameters()
    shapes = [p.shape for p in parameters]
    here, g = _flat([p.detach() for p in parameters]), _flat(gradient).double()
    probe = deepcopy(policy)
    counted = torch.from_numpy(mask)[..., None]
    seen = torch.where(counted, outputs.detach(), 0.0)

    def change_of_outputs(step: Tensor) -> Tensor:
        probe.load_vector((here + step).numpy())
        with torch.no_grad():
            return torch.where(counted, outputs_with(probe) - seen, 0.0)

    def fisher_product(v: Tensor) -> Tensor:
        scale = PROBE / float(v.norm())
        weighted = policy.head.fisher(seen, change_of_outputs(scale * v)) / (scale * counted.sum())  # M J v
        product = torch.autograd.grad(outputs, parameters, weighted, retain_graph=True)
        return _flat(list(product)).double() + damping * v

    x, residual, direction = torch.zeros_like(g), g.clone(), g.clone()
    left = start = float(g @ g)
    if not math.isfinite(start):
        return gradient  # it has no direction, and the caller will refuse it
    for _ in range(ITERATIONS):
        if left <= TOLERANCE * start:
            break
        image = fisher_product(direction)
        along = float(direction @ image)
        if along <= 0.0:  # only rounding is left
            break
        x += left / along * direction
        residual -= left / along * image
        before, left = left, float(residual @ residual)
        direction = residual + left / before * direction
    gain = float(x @ g)
    if gain <= 0.0:  # there is no gradient, or not to be told from rounding
        return [torch.zeros_like(part) for part in gradient]
    x *= math.sqrt(2.0 * divergence / gain)
    for _ in range(SHORTENINGS):
        change = change_of_outputs(x)
        reached = float((change * policy.head.fisher(seen, change)).sum() / (2.0 * counted.sum()))
        if reached <= SLACK * divergence:
            break
        x *= max(math.sqrt(divergence / reached), 0.1)
    sizes = [math.prod(shape) for shape in shapes]
    return [part.view(shape).float() for part, shape in zip(x.split(sizes), shapes, strict=True)]


def _flat(tensors: list[Tensor]) -> Tensor:
    return torch.cat([tensor.reshape(-1) for tensor in tensors])
