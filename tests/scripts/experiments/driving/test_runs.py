"""Runs that learn to steer while they drive; the plain one is ``python train.py algo=rpg env=track``."""

from __future__ import annotations

import numpy as np
import pytest

from scripts.experiments.driving import runs
from scripts.experiments.driving.log import CURVE, FAILS, FOR_GOOD, LAP, NO_LAP, OFF, SETTLED, UNSEEN
from scripts.experiments.driving.runs import learned, measure, measure_and_drive_on, measure_until_failure

MINUTES = 8


def seconds_off_the_road(seed: int) -> tuple[float, float]:
    """In the first two minutes and in the last two."""
    _, drive = learned(("algo=rpg", "env=track", f"total_steps={MINUTES * 1800}"), seed)
    off = drive.off_seconds
    return sum(off[:2]), sum(off[-2:])


def test_a_car_learns_to_stay_on_the_road_while_it_drives() -> None:
    before, after = np.median([seconds_off_the_road(seed) for seed in range(3)], axis=0)
    assert before > 0.2  # it has left the road once at least, and been put back after 0.3 s
    assert after < 0.2


def test_a_drive_until_failure_ends_when_the_policy_fails() -> None:
    overrides = ("experiment=driving_thesis", "env=track", "total_steps=14_000")  # which does not keep to the road
    until, on = measure_until_failure(overrides, 0), measure(overrides, 0)
    assert on["env_steps"] == 14_000
    assert 9_000 <= until["env_steps"] < 14_000  # no policy fails in its first five minutes
    assert until[FAILS] == pytest.approx(10.0 + 60.0 * until["env_steps"] / 54_000)
    assert until[CURVE] == pytest.approx(on[CURVE][: len(until[CURVE]) - 1] + until[CURVE][-1:])


def test_what_has_learned_drives_on_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "ONWARDS_STEPS", 9000)
    overrides = ("experiment=driving_thesis", "env=track", "total_steps=1000")  # a single update: it goes straight on
    alone, followed = measure(overrides, 0), measure_and_drive_on(overrides, 0)
    for metric in (SETTLED, FOR_GOOD, OFF, UNSEEN, "env_steps"):
        assert followed[metric] == alone[metric]
    assert 70.0 < followed[FAILS] < 80.0  # before the end
    assert followed[LAP] == NO_LAP


def test_a_limit_that_is_given_again_replaces_the_first() -> None:
    run, drive = learned(("algo=rpg", "env=track", "total_steps=9000", "total_steps=1000"), 0)
    assert 1000 <= run.algorithm.env_steps == len(drive.speed) < 9000
