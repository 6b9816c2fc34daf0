"""Policies: recurrent cores, action heads, their compiled twins, and a runner that keeps a policy's memory.

Read ``policy.py`` first, then one of ``cores/`` and one of ``heads/``.
"""

from dpsearch.policies.config import PolicyConfig
from dpsearch.policies.cores import CORES, Core
from dpsearch.policies.heads import Categorical, Deterministic, Gaussian, Head
from dpsearch.policies.observations import UnsupportedSpaceError
from dpsearch.policies.policy import RecurrentPolicy
from dpsearch.policies.runner import PolicyRunner

__all__ = [
    "CORES",
    "Categorical",
    "Core",
    "Deterministic",
    "Gaussian",
    "Head",
    "PolicyConfig",
    "PolicyRunner",
    "RecurrentPolicy",
    "UnsupportedSpaceError",
]
