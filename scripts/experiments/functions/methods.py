"""The searches that are measured on the functions of table 4.1, with their settings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from dpsearch.search.fem import THESIS
from scripts.experiments.experiment import Method

MAX_EVALUATIONS = 50_000


def _defaults(dimension: int) -> dict[str, Any]:
    return {}


def _fem(dimension: int) -> dict[str, Any]:
    """Section 5.4.1: one setting for d = 5, which serves below too, and one for d = 15."""
    if dimension <= 5:
        return {**THESIS, "forget_factor": 0.1, "covariance_forget_factor": 0.1, "window": 50, "top": 5}
    return {**THESIS, "forget_factor": 0.02, "covariance_forget_factor": 0.02, "window": 25, "top": 10}


@dataclass(frozen=True)
class Searcher(Method):
    """A search and its settings.

    Attributes:
        search: Name of the search.
        options: Function that gives the search's options in d dimensions.
        max_evaluations: Evaluations after which a run on a unimodal function has failed.
    """

    search: str = ""
    options: Callable[[int], dict[str, Any]] = _defaults
    max_evaluations: int = MAX_EVALUATIONS


NES = Searcher("nes", "NES", search="nes")
NES_FRESH = Searcher(
    "nes_fresh",
    "NES without importance mixing",
    search="nes",
    options=lambda d: {"importance_mixing": False},
    max_evaluations=2 * MAX_EVALUATIONS,
)
NES_EXACT = Searcher(
    "nes_exact",
    "NES, exact gradient, population 7 d",
    search="nes",
    options=lambda d: {"gradient": "exact", "population": 7 * d},
)
FEM = Searcher("fem", "FEM", search="fem", options=_fem)
FEM_DEFAULT = Searcher("fem_default", "FEM, covariance slower than the mean", search="fem")
CMAES = Searcher("cmaes", "CMA-ES", search="cmaes")
XNES = Searcher("xnes", "xNES", search="xnes")
XNES_MIXING = Searcher(
    "xnes_im",
    "xNES, importance mixing, population 4 d",
    search="xnes",
    options=lambda d: {"importance_mixing": True, "population": 4 * d},
)
SNES = Searcher("snes", "SNES", search="snes")

METHODS = {
    method.name: method for method in (NES, FEM, CMAES, NES_EXACT, XNES_MIXING, XNES, SNES, FEM_DEFAULT, NES_FRESH)
}
