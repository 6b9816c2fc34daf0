"""An environment that no policy can play: nobody knows how much there will be to see."""

from typing import Any

import gymnasium as gym
from gymnasium import spaces


class Wordy(gym.Env[tuple[int, ...], Any]):
    """Shows any number of symbols."""

    observation_space = spaces.Sequence(spaces.Discrete(3))
    action_space = spaces.Discrete(2)


if "tests/Wordy-v0" not in gym.registry:
    gym.register("tests/Wordy-v0", "tests.support.odd_envs:Wordy", max_episode_steps=10)
