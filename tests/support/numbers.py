"""Random numbers for a few steps of a few episodes."""

from __future__ import annotations

import numpy as np
import torch

SHAPE = (5, 3)  # time, episodes


def normal(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def uniform(*shape: int, seed: int = 0) -> torch.Tensor:
    words = np.random.default_rng(seed).integers(2**32, size=shape)
    return torch.from_numpy((words + 0.5) * 2.0**-32)
