"""Environments that go wrong: one that no policy can play, and one that raises now and then."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces


class Wordy(gym.Env[tuple[int, ...], Any]):
    """Shows any number of symbols."""

    observation_space = spaces.Sequence(spaces.Discrete(3))
    action_space = spaces.Discrete(2)


if "tests/Wordy-v0" not in gym.registry:
    gym.register("tests/Wordy-v0", "tests.support.odd_envs:Wordy", max_episode_steps=10)


class Stuck(gym.Env[Any, Any]):
    """Two steps; with one seed in ten the second one raises."""

    def __init__(self) -> None:
        self.observation_space = spaces.Box(0.0, 1.0, (1,))
        self.action_space = spaces.Discrete(2)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.fails, self.steps = seed is not None and seed % 10 == 0, 0
        return np.zeros(1, np.float32), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.steps += 1
        if self.fails and self.steps == 2:
            raise RuntimeError("out of fuel")
        return np.ones(1, np.float32), float(action), self.steps == 2, False, {}


gym.register("tests/Stuck-v0", "tests.support.odd_envs:Stuck", max_episode_steps=9)
