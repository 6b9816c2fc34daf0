"""The natural gradient: the direction of steepest ascent where distance is how much the policy's behaviour changes.

    x = (F + damping I)^-1 g,    F = 1/M sum_t J_t^T M_t J_t

J_t are the derivatives of the policy's outputs at step t by its parameters, and M_t is the Fisher information of its
distribution over actions there; so x'F x / 2 is, to second order, the mean KL divergence of a step x (Kakade, NIPS
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

from dpsearch.policies import RecurrentPolicy

ITERATIONS = 10  # of conjugate gradients: more changes little
TOLERANCE = 1e-3  # of the squared residual, relative to the gradient's
PROBE = 1e-2  # length of the step in parameters whose effect on the outputs is measured


def natural_gradient(
    policy: RecurrentPolicy,
    gradient: list[Tensor],
    outputs: Tensor,
    unroll: Callable[[RecurrentPolicy], Tensor],
    mask: NDArray[np.bool_],
    damping: float,
) -> tuple[list[Tensor], float]:
    """The natural gradient, by conjugate gradients.

    Args:
        policy: Whose.
        gradient: By each of its free parameters.
        outputs: Its outputs ``(T, B, n_outputs)``, with the graph that leads to the parameters.
        unroll: What makes such outputs with a policy of the same architecture.
        mask: ``(T, B)``, False on padding.
        damping: What is added to F's diagonal.

    Returns:
        The natural gradient by each of the parameters, and its product with the gradient, which is twice the mean KL
        divergence of a step of that length, to second order.
    """
    parameters = policy.free_parameters()
    shapes = [p.shape for p in parameters]
    here, g = _flat([p.detach() for p in parameters]), _flat(gradient).double()
    probe = deepcopy(policy)
    counted = torch.from_numpy(mask)[..., None]
    seen = torch.where(counted, outputs.detach(), 0.0)

    def fisher_product(v: Tensor) -> Tensor:
        scale = PROBE / float(v.norm())
        probe.load_vector((here + scale * v).numpy())
        with torch.no_grad():
            change = (unroll(probe) - outputs) / scale  # J v
        weighted = torch.where(counted, policy.head.fisher(seen, change), 0.0) / counted.sum()
        product = torch.autograd.grad(outputs, parameters, weighted, retain_graph=True)
        return _flat(list(product)).double() + damping * v

    x, residual, direction = torch.zeros_like(g), g.clone(), g.clone()
    left = start = float(g @ g)
    for _ in range(ITERATIONS):
        if left <= TOLERANCE * start:
            break
        image = fisher_product(direction)
        along = float(direction @ image)
        if along <= 0.0:  # rounding has the last word
            break
        x += left / along * direction
        residual -= left / along * image
        before, left = left, float(residual @ residual)
        direction = residual + left / before * direction
    sizes = [math.prod(shape) for shape in shapes]
    parts = [part.view(shape).float() for part, shape in zip(x.split(sizes), shapes, strict=True)]
    return parts, float(x @ g)


def _flat(tensors: list[Tensor]) -> Tensor:
    return torch.cat([tensor.reshape(-1) for tensor in tensors])
