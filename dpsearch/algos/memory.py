"""Memory that sizes ask for, so that what can never fit is refused before anything is made."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch

from dpsearch.policies import RecurrentPolicy

WEIGHT_BYTES = 16
"""Least memory that a weight takes while it is learned: itself, its gradient, and a copy in double precision."""


def require_memory(setting: str, size: float, purpose: str, instead: str = "") -> None:
    """Refuse a setting that asks for more memory than is free.

    Args:
        setting: Name of the setting.
        size: Least memory that it asks for (bytes).
        purpose: Who takes the memory, for the error message.
        instead: Another way to do it, for the error message.

    Raises:
        ValueError: If that much is not free.
    """
    free = free_memory()
    if size > free:
        raise ValueError(
            f"{setting} is too large: {purpose} would take {size / 2**30:,.3g} GiB of memory, "
            f"of which {free / 2**30:,.3g} GiB are free{instead}"
        )


def free_memory() -> float:
    """Memory of the machine, or of the container, that is not taken yet (bytes); infinite if unknown."""
    free = float("inf")
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                free = 1024.0 * int(line.split()[1])
    except OSError:  # not Linux
        if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
            free = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    try:
        limit, used = (Path(f"/sys/fs/cgroup/memory.{name}").read_text() for name in ("max", "current"))
        return min(free, float(int(limit) - int(used)))
    except (OSError, ValueError):  # no container, or one without a limit, "max"
        return free


def check_weights(make: Callable[[], RecurrentPolicy]) -> None:
    """Refuse a policy whose weights do not fit into memory; to count them, it is made without taking any.

    Raises:
        ValueError: If they do not.
    """
    try:
        with torch.device("meta"):
            weights: float = sum(weights.numel() for weights in make().parameters())
    except RuntimeError as error:
        if "overflow" not in str(error):
            raise
        weights = float("inf")
    require_memory("hidden_size", WEIGHT_BYTES * weights, "the policy's weights")


def check_batches(config: Any, policy: RecurrentPolicy) -> None:
    """Refuse batches that surely do not fit into memory, as each episode or candidate takes so many bytes at least.

    Args:
        config: The settings of an algorithm.
        policy: The policy that it trains.

    Raises:
        ValueError: If one of the settings asks for more memory than is free.
    """
    step = 4 * (policy.observation_size + policy.head.action_size + 1)
    candidate = 8 * len(policy.vector())
    least = {"batch_size": step, "update_steps": step, "population": candidate, "episodes_per_fitness": 16}
    for name, size in least.items():
        if isinstance(number := getattr(config, name, None), int):
            require_memory(name, size * number, "what is played for an update")
    cells = getattr(getattr(config, "baseline", None), "cells", 0)
    require_memory("baseline.cells", 4 * WEIGHT_BYTES * cells**2, "the baseline's weights")


@contextmanager
def memory_errors() -> Iterator[None]:
    """Raise a MemoryError, as NumPy does, where torch raises a RuntimeError.

    Raises:
        MemoryError: If there is not enough memory.
    """
    try:
        yield
    except RuntimeError as error:
        if "allocate memory" not in str(error):
            raise
        raise MemoryError(f"there is not enough memory: {str(error).splitlines()[0]}") from error
