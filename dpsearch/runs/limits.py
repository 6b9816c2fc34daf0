"""Limits at which a run ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dpsearch.algos import Algorithm


@dataclass(frozen=True)
class Limits:
    """Limits of a run, counted from its very beginning; the first that is reached ends it.

    Attributes:
        total_steps: Number of environment steps; None for no limit.
        total_episodes: Number of episodes; None for no limit.
        total_updates: Number of updates; None for no limit.
        until_solved: Whether the run ends, too, when ``Algorithm.check_solved`` says that the task is solved.
    """

    total_steps: int | None = None
    total_episodes: int | None = None
    total_updates: int | None = None
    until_solved: bool = False

    def fraction(self, algorithm: Algorithm[Any]) -> float:
        """Share of the run that is done, by its limits: from 0 to 1, or more after a long update."""
        limits = (self.total_steps, self.total_episodes, self.total_updates)
        counts = (algorithm.env_steps, algorithm.episodes, algorithm.updates)
        return max((count / limit for count, limit in zip(counts, limits, strict=True) if limit), default=0.0)
