"""Kernels that are compiled when a run first needs them, and kept on disk for later processes.

A kernel has one version for each precision and layout of its arguments, of which a run needs one or two. A version is
compiled by the first call with arguments of its types, or by ``address_of`` (``lanes.py``) for the signature that it
is asked for. ``machine_code.py`` keeps it on disk, so that a later process loads it and compiles nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit

from dpsearch.kernels.lanes import Compiled
from dpsearch.kernels.machine_code import MachineCode


def on_demand(fastmath: set[str] | None = None) -> Callable[[Callable[..., Any]], Compiled]:
    """Decorator of a kernel: compile it on demand, keep it on disk, and let other threads run beside it.

    Args:
        fastmath: Freedom for the compiler in floating-point arithmetic, as ``FASTMATH``; None for none.

    Returns:
        The decorator.
    """
    compiler = njit(nogil=True, fastmath=fastmath or False, error_model="numpy")

    def decorate(function: Callable[..., Any]) -> Compiled:
        kernel: Any = compiler(function)
        kernel._cache = MachineCode(function)  # in place of Numba's own, which does not see what a function inlines
        return kernel  # type: ignore[no-any-return]

    return decorate
