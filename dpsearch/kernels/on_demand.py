"""Kernels that are compiled when a run first needs them, not when their module is imported.

A kernel has one version for each precision and layout of its arguments, of which a run needs one or two. A version is
compiled by the first call with arguments of its types, or by ``address_of`` (``lanes.py``) for the signature that it
is asked for. Numba keeps the version on disk, so that a later process loads it and compiles nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit

from dpsearch.kernels.lanes import Compiled


def on_demand(fastmath: set[str] | None = None) -> Callable[[Callable[..., Any]], Compiled]:
    """Decorator of a kernel: compile it on demand, cache it on disk, and let other threads run beside it.

    Args:
        fastmath: Freedom for the compiler in floating-point arithmetic, as ``FASTMATH``; None for none.

    Returns:
        The decorator.
    """
    decorator: Callable[[Callable[..., Any]], Compiled] = njit(
        cache=True, nogil=True, fastmath=fastmath or False, error_model="numpy"
    )
    return decorator
