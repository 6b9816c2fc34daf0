"""The plain command learns to steer: `python train.py algo=rpg env=track`."""

from __future__ import annotations

import numpy as np

from scripts.experiments.driving.log import Drive
from scripts.experiments.driving.tables import learner

MINUTES = 8


def seconds_off_the_road(seed: int) -> tuple[float, float]:
    """In the first two minutes and in the last two."""
    algorithm, rows = learner(("algo=rpg", "env=track"), seed)
    algorithm.learn(total_steps=MINUTES * 1800)
    algorithm.close()
    off = Drive(rows).off_seconds
    return sum(off[:2]), sum(off[-2:])


def test_a_car_learns_to_stay_on_the_road_while_it_drives() -> None:
    before, after = np.median([seconds_off_the_road(seed) for seed in range(3)], axis=0)
    assert before > 0.2  # it has left the road once at least, and been put back after 0.3 s
    assert after < 0.2
