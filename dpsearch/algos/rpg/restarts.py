"""When to restart from new random weights: from some weights learning stays at a point that it passes from others."""

from __future__ import annotations

import math
from collections import deque
from statistics import fmean
from typing import Any

from numpy.typing import NDArray

WINDOW = 100  # episodes whose mean return is compared; ``patience`` if that is less


class Progress:
    """Whether learning still improves the mean return: early stopping with patience, of a start instead of a run.

    Progress is relative, so that it does not depend on the unit of reward. From a mean of exactly 0 only a positive one
    is progress: where no return is above 0, something else has to end a run that got there, as ``until_solved`` does.

    Args:
        patience: Episodes without progress after which learning has stalled; None for never.
        gain: Progress is a mean return of the last ``WINDOW`` episodes that is higher than at the last progress by more
            than this share of its size.
    """

    def __init__(self, patience: int | None, gain: float) -> None:
        self._patience, self._gain = patience, gain
        self._recent: deque[float] = deque(maxlen=min(WINDOW, patience or WINDOW))
        self._bar, self._since = -math.inf, 0

    @property
    def stalled(self) -> bool:
        """Whether ``patience`` episodes have gone by without progress."""
        return self._patience is not None and self._since >= self._patience

    def note(self, returns: NDArray[Any]) -> None:
        """Note the returns ``(N,)`` of the next episodes."""
        if self._patience is None:
            return
        self._since += len(returns)
        self._recent.extend(returns.tolist())
        mean = fmean(self._recent)
        if len(self._recent) == self._recent.maxlen and mean > self._bar:
            self._bar, self._since = mean + self._gain * abs(mean), 0

    def state_dict(self) -> dict[str, Any]:
        """Everything that later answers depend on."""
        return {"recent": list(self._recent), "bar": self._bar, "since": self._since}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from where ``state_dict`` was taken."""
        self._recent.clear()
        self._recent.extend(state["recent"])
        self._bar, self._since = state["bar"], state["since"]
