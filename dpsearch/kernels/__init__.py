"""Ground floor: the layout of lanes, keyed randomness, and the arithmetic that compiled rollouts are made of."""

import warnings

from numba import config

if getattr(config, "DISABLE_JIT", 0):
    warnings.warn("NUMBA_DISABLE_JIT is ignored: engines call kernels by their addresses in memory", stacklevel=1)
    vars(config)["DISABLE_JIT"] = 0
