"""Rollouts, the source of episodes: two verbs, ``collect`` and ``evaluate``, and the engines that offer them."""

from dpsearch.rollout.base import EnvironmentFailedError, Rollouts
from dpsearch.rollout.episodes import Episodes
from dpsearch.rollout.gym_engine import GymEngine, OnError
from dpsearch.rollout.gym_envs import EnvSource
from dpsearch.rollout.lane_engine import LaneEngine
from dpsearch.rollout.make import make_rollouts
from dpsearch.rollout.recipe import EnvRecipe
from dpsearch.rollout.stream import Pieces, Stream

__all__ = [
    "EnvRecipe",
    "EnvSource",
    "EnvironmentFailedError",
    "Episodes",
    "GymEngine",
    "LaneEngine",
    "OnError",
    "Pieces",
    "Rollouts",
    "Stream",
    "make_rollouts",
]
