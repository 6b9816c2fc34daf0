"""A small RPG, and what it comes to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpsearch.algos import RPG
from dpsearch.envs.tmaze import TMaze
from dpsearch.policies import PolicyConfig

HORIZON = 4  # steps of the small POMDP: all 2 * 4**4 histories can be listed


def small_rpg(**settings: Any) -> RPG:
    policy = PolicyConfig(hidden_size=3, init_range=0.7)
    return RPG(TMaze(corridor_length=1, max_episode_steps=HORIZON), policy=policy, **{"gamma": 1.0, **settings})


def gradients(rpg: RPG) -> NDArray[np.float64]:
    found = [p.grad.numpy().ravel() for p in rpg.parameters if p.grad is not None]
    assert len(found) == len(rpg.parameters)
    return np.concatenate(found).astype(np.float64)
