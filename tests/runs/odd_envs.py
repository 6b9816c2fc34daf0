"""An environment that no policy can play: it speaks."""

from typing import Any

import gymnasium as gym
from gymnasium import spaces


class Wordy(gym.Env[str, Any]):
    """Shows text."""

    observation_space = spaces.Text(8)
    action_space = spaces.Discrete(2)


if "tests/Wordy-v0" not in gym.registry:
    gym.register("tests/Wordy-v0", Wordy, max_episode_steps=10)
