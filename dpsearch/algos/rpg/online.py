"""Learning online: an update every few steps of one continuing stream, for tasks that go on (section 3.4.4).

The gradient is cut off where the update is. The recurrent state is carried on, and the return that the baseline
predicts at the cut completes the returns before it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from dpsearch.algos.base import Algorithm, Metrics
from dpsearch.algos.rpg.config import RPGConfig
from dpsearch.algos.rpg.source import Source
from dpsearch.rollout import Episodes, Pieces, Stream


class Online(Source):
    """The next ``update_steps`` steps of one stream, cut into pieces where episodes end.

    Raises:
        ValueError: If the environment came ready made, so that there cannot be one more.
    """

    def __init__(self, learner: Algorithm[RPGConfig]) -> None:
        super().__init__(learner)
        self._stream = Stream(learner.rollouts, learner.training_key)
        self._reward = 0.0  # mean of a step since the last update

    @override
    def play(self) -> Pieces:
        learner, steps = self._learner, self._learner.config.update_steps
        assert steps is not None
        pieces = self._stream.play(learner.policy, steps)
        learner.count(pieces.finished.tolist(), pieces.steps)
        self._reward = float(pieces.returns.sum()) / pieces.steps
        return pieces

    @override
    def metrics(self, episodes: Episodes) -> Metrics:
        return {"reward": self._reward}

    @property
    @override
    def headline(self) -> str:
        return f"reward {self._reward:,.4g} a step"

    @override
    def caution(self, advantages: NDArray[np.float32]) -> float:
        """Mean square of normalised advantages, at most 1: where all goes as expected, steps are small."""
        return min(float(np.square(advantages).mean()), 1.0) if self._learner.config.normalise_advantages else 1.0

    @override
    def close(self) -> None:
        self._stream.close()

    @override
    def state_dict(self) -> dict[str, Any]:
        return {"stream": self._stream.state_dict(), "reward": self._reward}

    @override
    def load_state_dict(self, state: dict[str, Any]) -> None:
        self._stream.load_state_dict(state["stream"])
        self._reward = state["reward"]
