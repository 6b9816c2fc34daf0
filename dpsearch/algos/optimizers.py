"""The optimisers of ``torch.optim``, by name."""

from __future__ import annotations

from collections.abc import Iterable
from inspect import signature
from typing import Any

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


class GradientDescent(torch.optim.SGD):
    """``torch.optim.SGD`` without options, in a single call: what it makes of none takes as long as a short episode."""

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
    """An optimiser of these parameters.

    Args:
        name: One of ``OPTIMIZERS``.
        parameters: What it adjusts.
        learning_rate: Its step size.
        options: Its other arguments.

    Raises:
        ValueError: If it does not take these arguments.
    """
    kind = GradientDescent if name == "SGD" and not options else getattr(torch.optim, name)
    try:
        optimizer: torch.optim.Optimizer = kind(parameters, lr=learning_rate, **options)
    except (TypeError, ValueError) as error:
        known = ", ".join(sorted(set(signature(getattr(torch.optim, name)).parameters) - {"params", "lr"}))
        raise ValueError(f"optimizer_options do not fit {name}, which takes {known}: {error}") from error
    return optimizer
