"""The optimisers of ``torch.optim``, by name."""

from __future__ import annotations

from collections.abc import Iterable
from inspect import signature
from typing import Any

import torch
from torch import nn

OPTIMIZERS = sorted(
    name
    for name, kind in vars(torch.optim).items()
    if isinstance(kind, type) and issubclass(kind, torch.optim.Optimizer)
    # the first is the base class, the others need a closure, sparse gradients, or matrices
    if name not in ("Optimizer", "LBFGS", "SparseAdam", "Muon")
)


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
    try:
        optimizer: torch.optim.Optimizer = getattr(torch.optim, name)(parameters, lr=learning_rate, **options)
    except (TypeError, ValueError) as error:
        known = ", ".join(sorted(set(signature(getattr(torch.optim, name)).parameters) - {"params", "lr"}))
        raise ValueError(f"optimizer_options do not fit {name}, which takes {known}: {error}") from error
    return optimizer
