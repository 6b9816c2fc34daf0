"""Small environments that show what an engine does with them."""

from copy import deepcopy
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces

SHORT, LONG = 2, 12


class Countdown(gym.Env[Any, Any]):
    """Ends after 2 or 12 steps, equally likely; shows how many are left and pays the action it gets.

    `observed` and `action_space` may be any space: its samples are what is seen, beside the count.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(self, action_space: gym.Space[Any] | None = None, observed: gym.Space[Any] | None = None) -> None:
        count = spaces.Box(0.0, LONG, (1,))
        self.observation_space = count if observed is None else spaces.Dict(count=count, noise=observed)
        self.action_space = action_space or spaces.Discrete(2)
        self.observed = deepcopy(observed)  # with a random generator of its own
        self.actions: list[Any] = []
        self.closed = False

    def _observation(self) -> Any:
        count = np.array([self.left], np.float32)
        return count if self.observed is None else {"count": count, "noise": self.observed.sample()}

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        if self.observed is not None and seed is not None:
            self.observed.seed(seed)
        self.left = int(self.np_random.choice([SHORT, LONG]))
        return self._observation(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        assert self.action_space.contains(action)
        assert self.left > 0, "stepped after the end"
        self.actions.append(action)
        self.left -= 1
        return self._observation(), float(np.sum(action)), self.left == 0, False, {}

    def close(self) -> None:
        self.closed = True


class Broken(Countdown):
    """Goes wrong in the third step of an episode that has so many: shows NaN, or raises."""

    def __init__(self, how: str) -> None:
        super().__init__()
        self.how = how

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = super().step(action)
        if self.left == LONG - 3:
            if self.how == "raise":
                raise RuntimeError("the motor is on fire")
            observation[:] = np.nan
        return observation, reward, terminated, truncated, info
