"""Sources of the episodes of an update: batches of whole episodes, or, in ``online.py``, one continuing stream."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from dpsearch.algos.base import Algorithm, Metrics
from dpsearch.algos.rpg.config import RPGConfig
from dpsearch.rollout import Episodes

MOST = 64  # times ``batch_size``: the most episodes in a batch whose size is counted in steps


class Source(ABC):
    """Plays the episodes that RPG learns from.

    Args:
        learner: The algorithm, whose rollouts play, whose policy acts, and whose counters count.
    """

    def __init__(self, learner: Algorithm[RPGConfig]) -> None:
        self._learner = learner

    @abstractmethod
    def play(self) -> Episodes:
        """Play and count the episodes of the next update."""

    @abstractmethod
    def metrics(self, episodes: Episodes) -> Metrics:
        """Scalars to log: the reward earned in these episodes."""

    @property
    def headline(self) -> str | None:
        """The present performance in two or three words; None for the mean return of recent episodes."""
        return None

    def caution(self, advantages: NDArray[np.float32]) -> float:
        """Factor of the divergence of a natural step, in [0, 1], for advantages ``(M,)``."""
        return 1.0

    @abstractmethod
    def close(self) -> None:
        """Close the environments that were made here."""

    @abstractmethod
    def state_dict(self) -> dict[str, Any]:
        """Everything that later episodes depend on."""

    @abstractmethod
    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from where ``state_dict`` was taken."""


class Batches(Source):
    """Batches of whole episodes, ``batch_size`` of them, or as many as ``batch_steps`` environment steps take."""

    def __init__(self, learner: Algorithm[RPGConfig]) -> None:
        super().__init__(learner)
        self._size = learner.config.batch_size

    @override
    def play(self) -> Episodes:
        config = self._learner.config
        episodes = self._learner.play_batch(self._size)
        if config.batch_steps is not None:
            fitting = round(config.batch_steps * len(episodes) / episodes.steps)
            self._size = min(max(fitting, config.batch_size), MOST * config.batch_size)
        return episodes

    @override
    def metrics(self, episodes: Episodes) -> Metrics:
        n = len(episodes)
        return {"return": float(episodes.returns.sum()) / n, "episode_length": episodes.steps / n}

    @override
    def close(self) -> None:
        pass  # the rollouts are the learner's

    @override
    def state_dict(self) -> dict[str, Any]:
        return {"batch_size": self._size}

    @override
    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._size = state["batch_size"]
