"""Black-box optimisers behind one interface, useful without any reinforcement learning; see ``search.base``."""

from __future__ import annotations

from dpsearch.search.base import Best, Result, Search
from dpsearch.search.cmaes import CMAES
from dpsearch.search.fem import FEM
from dpsearch.search.nes import NES
from dpsearch.search.restarts import Restarts
from dpsearch.search.snes import SNES
from dpsearch.search.xnes import XNES

SEARCHES: dict[str, type[Search]] = {search.name: search for search in (NES, XNES, SNES, FEM, CMAES)}
"""Searches by name."""

__all__ = ["CMAES", "FEM", "NES", "SEARCHES", "SNES", "XNES", "Best", "Restarts", "Result", "Search"]
