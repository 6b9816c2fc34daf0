"""Algorithms: one a file, each beside its chapter of the thesis."""

from typing import Any

from dpsearch.algos.base import Algorithm, Evaluation
from dpsearch.algos.policy_search import (
    CMAESPolicySearch,
    FEMPolicySearch,
    NESPolicySearch,
    PolicySearch,
    SNESPolicySearch,
    XNESPolicySearch,
)
from dpsearch.algos.rpg import RPG, RPGConfig

ALGORITHMS: dict[str, type[Algorithm[Any]]] = {
    algorithm.name: algorithm
    for algorithm in (
        RPG,
        NESPolicySearch,
        XNESPolicySearch,
        SNESPolicySearch,
        FEMPolicySearch,
        CMAESPolicySearch,
    )
}
"""Algorithms by the name that configurations and checkpoints use."""

__all__ = [
    "ALGORITHMS",
    "RPG",
    "Algorithm",
    "CMAESPolicySearch",
    "Evaluation",
    "FEMPolicySearch",
    "NESPolicySearch",
    "PolicySearch",
    "RPGConfig",
    "SNESPolicySearch",
    "XNESPolicySearch",
]
