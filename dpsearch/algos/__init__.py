"""Algorithms: one a file, each beside its chapter of the thesis."""

from typing import Any

from dpsearch.algos.base import Algorithm, Evaluation
from dpsearch.algos.rpg import RPG, RPGConfig

ALGORITHMS: dict[str, type[Algorithm[Any]]] = {RPG.name: RPG}
"""Algorithms by the name that configurations and checkpoints use."""

__all__ = ["ALGORITHMS", "RPG", "Algorithm", "Evaluation", "RPGConfig"]
