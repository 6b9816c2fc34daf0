"""When a run is over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dpsearch.algos import Algorithm


@dataclass(frozen=True)
class Limits:
    """What ends a run, counted from its very beginning; the first that is reached does.

    Attributes:
        total_steps: Environment steps.
        total_episodes: Episodes.
        total_updates: Updates.
        until_solved: Also when ``Algorithm.check_solved`` says so.
    """

    total_steps: int | None = None
    total_episodes: int | None = None
    total_updates: int | None = None
    until_solved: bool = False

    def fraction(self, algorithm: Algorithm[Any]) -> float:
        """How much of the run is done, as far as the numbers tell: from 0 to 1, or more after a long update."""
        limits = (self.total_steps, self.total_episodes, self.total_updates)
        counts = (algorithm.env_steps, algorithm.episodes, algorithm.updates)
        return max((count / limit for count, limit in zip(counts, limits, strict=True) if limit), default=0.0)
