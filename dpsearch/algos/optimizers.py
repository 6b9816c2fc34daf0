"""Optimisers of ``torch.optim`` by name, and the length of gradients."""

from __future__ import annotations

from collections.abc import Iterable
from inspect import signature
from math import isfinite, sqrt
from typing import Any

import numpy as np
import torch
from torch import nn
from typing_extensions import override

OPTIMIZERS = sorted(
    name
    for name, kind in vars(torch.optim).items()
    if isinstance(kind, type) and issubclass(kind, torch.optim.Optimizer)
    # the first is the base class, the others need a closure, sparse gradients, or matrices
    if name not in ("Optimizer", "LBFGS", "SparseAdam", "Muon")
)

TINY, LARGEST = torch.finfo(torch.float32).tiny, torch.finfo(torch.float32).max


class GradientDescent(torch.optim.SGD):
    """``torch.optim.SGD`` without options, in a single call: its bookkeeping takes as long as a short episode."""

    @override
    @torch.no_grad()
    def step(self, closure: Any = None) -> Any:
        """One step down the gradient; there is no closure."""
        for group in self.param_groups:
            learning = [p for p in group["params"] if p.grad is not None]
            torch._foreach_add_(learning, [p.grad for p in learning], alpha=-group["lr"])

    step.hooked = True  # type: ignore[attr-defined]  # torch wraps a step in hooks and profiling unless it says this


def make_optimizer(
    name: str, parameters: Iterable[nn.Parameter], learning_rate: float, options: dict[str, Any]
) -> torch.optim.Optimizer:
    """A new optimiser.

    Args:
        name: One of ``OPTIMIZERS``.
        parameters: The parameters to adjust.
        learning_rate: Step size.
        options: Other arguments of the class.

    Raises:
        ValueError: If the class does not take these arguments.
    """
    if learning_rate > LARGEST:
        raise ValueError(f"learning_rate must be below {LARGEST:.2g}, what a weight can be, got {learning_rate}")
    for option, value in options.items():
        numbers = value if isinstance(value, list | tuple) else [value]
        if any(isinstance(number, float) and not isfinite(number) for number in numbers):
            raise ValueError(f"optimizer_options must be finite, got {option}={value}")
    kind = GradientDescent if name == "SGD" and not options else getattr(torch.optim, name)
    try:
        optimizer: torch.optim.Optimizer = kind(parameters, lr=learning_rate, **options)
    except (TypeError, ValueError) as error:
        known = ", ".join(sorted(set(signature(getattr(torch.optim, name)).parameters) - {"params", "lr"}))
        raise ValueError(f"optimizer_options do not fit {name}, which takes {known}: {error}") from error
    return optimizer


def set_learning_rate(optimizer: torch.optim.Optimizer, learning_rate: float) -> None:
    """Change the step size of all parameters."""
    for group in optimizer.param_groups:
        group["lr"] = learning_rate


def normalise_gradient(parameters: Iterable[nn.Parameter], length: float | None, update: int) -> float:
    """Scale the gradient of all parameters together to a length; returns the length it had.

    Args:
        parameters: Parameters, whose ``grad`` is scaled; those without ``grad`` do not count.
        length: Length of the gradient afterwards; None leaves the gradient as it is. A gradient of length 0 stays.
        update: Number of the update, for the error message.

    Raises:
        FloatingPointError: If the gradient is not finite.
    """
    gradients = [g.numpy() for p in parameters if (g := p.grad) is not None]  # NumPy's calls cost less than torch's
    flat = np.concatenate(gradients, axis=None, dtype=np.float64)
    before = sqrt(flat @ flat)
    if not isfinite(before):
        raise FloatingPointError(
            f"the gradient of update {update} is not finite: the steps or the rewards are too large"
        )
    if length is not None and before > TINY:
        for gradient in gradients:
            gradient *= length / before
    return before
