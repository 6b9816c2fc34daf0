"""Ground floor: the layout of lanes, keyed randomness, and the arithmetic that compiled rollouts are made of."""

import warnings

from numba import config

if config.DISABLE_JIT:
    warnings.warn("NUMBA_DISABLE_JIT is ignored: engines call kernels by their addresses in memory", stacklevel=1)
    config.DISABLE_JIT = 0
