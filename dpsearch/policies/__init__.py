"""Policies: recurrent cores, action heads, their compiled twins, and a runner that keeps their memory."""

from dpsearch.policies.heads import Categorical, Deterministic, Gaussian, Head
from dpsearch.policies.observations import UnsupportedSpaceError
from dpsearch.policies.policy import PolicyConfig, RecurrentPolicy
from dpsearch.policies.runner import PolicyRunner

__all__ = [
    "Categorical",
    "Deterministic",
    "Gaussian",
    "Head",
    "PolicyConfig",
    "PolicyRunner",
    "RecurrentPolicy",
    "UnsupportedSpaceError",
]
