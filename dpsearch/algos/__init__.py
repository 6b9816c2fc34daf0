"""Algorithms: RPG (chapter 3, ``rpg/``), LRWR (chapter 6) and policy search by black-box optimisers (chapters 4, 5)."""

from typing import Any

from dpsearch.algos.base import Algorithm
from dpsearch.algos.evaluation import Evaluation
from dpsearch.algos.lrwr import LRWR, LRWRConfig
from dpsearch.algos.policy_search import (
    CMAESPolicySearch,
    FEMPolicySearch,
    NESPolicySearch,
    PolicySearch,
    SNESPolicySearch,
    XNESPolicySearch,
)
from dpsearch.algos.rpg.config import RPGConfig
from dpsearch.algos.rpg.rpg import RPG

ALGORITHMS: dict[str, type[Algorithm[Any]]] = {
    algorithm.name: algorithm
    for algorithm in (
        RPG,
        LRWR,
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
    "LRWR",
    "RPG",
    "Algorithm",
    "CMAESPolicySearch",
    "Evaluation",
    "FEMPolicySearch",
    "LRWRConfig",
    "NESPolicySearch",
    "PolicySearch",
    "RPGConfig",
    "SNESPolicySearch",
    "XNESPolicySearch",
]
