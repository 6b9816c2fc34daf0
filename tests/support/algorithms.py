"""A small RPG, and what it comes to."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpsearch.algos import RPG
from dpsearch.envs.tmaze import TMaze
from dpsearch.policies import PolicyConfig

NO_BASELINE = {"kind": "constant", "episodes": 0}
HORIZON = 4  # steps of the small POMDP: all 2 * 4**4 histories can be listed


def small_rpg(**settings: Any) -> RPG:
    given = {"gamma": 1.0, "policy": PolicyConfig(hidden_size=3, init_range=0.7), **settings}
    return RPG(TMaze(corridor_length=1, max_episode_steps=HORIZON), **given)


def gradients(rpg: RPG) -> NDArray[np.float64]:
    found = [p.grad.numpy().ravel() for p in rpg.parameters if p.grad is not None]
    assert len(found) == len(rpg.parameters)
    return np.concatenate(found).astype(np.float64)
