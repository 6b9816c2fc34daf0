"""Where episodes come from: two verbs, ``collect`` and ``evaluate``, and the engines that offer them."""

from dpsearch.rollout.compiled import CompiledRollouts
from dpsearch.rollout.episodes import Episodes
from dpsearch.rollout.gym_lanes import EnvSource
from dpsearch.rollout.make import make_rollouts
from dpsearch.rollout.protocol import Rollouts
from dpsearch.rollout.stream import Pieces, Stream
from dpsearch.rollout.vector import VectorRollouts

__all__ = [
    "CompiledRollouts",
    "EnvSource",
    "Episodes",
    "Pieces",
    "Rollouts",
    "Stream",
    "VectorRollouts",
    "make_rollouts",
]
