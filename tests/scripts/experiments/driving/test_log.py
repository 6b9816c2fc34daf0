"""The metrics of a drive."""

from __future__ import annotations

from array import array

import numpy as np
import pytest

from scripts.experiments.driving.log import NO_LAP, Drive

LENGTH = 1000.0


def drive(speed: float, steps: int, off: slice | None = None, *, circling: bool = False) -> Drive:
    """At one speed (km/h), along the road or in a circle."""
    way = np.arange(1, steps + 1) * speed / 3.6 / 30.0
    lap_steps = int(LENGTH / (speed / 3.6 / 30.0)) + 1
    rows = np.zeros((steps, 5))
    rows[:, 0] = speed
    rows[:, 2] = 500.0 + 3.0 * np.sin(way) if circling else way % LENGTH
    rows[lap_steps:, 3] = 0.0 if circling else lap_steps / 30.0
    if off is not None:
        rows[off, 4] = 1.0
    return Drive(array("d", rows.ravel()))


def test_a_clean_drive() -> None:
    book = drive(72.0, 12_000)
    assert book.settled == 0.0
    assert book.last_off == 0.0
    assert book.clean_speed == pytest.approx(72.0)
    assert book.best_lap == pytest.approx(50.0, abs=0.1)
    assert sum(book.off_seconds) == 0.0


def test_leaving_the_road_counts() -> None:
    book = drive(72.0, 14_000, slice(100, 1600))
    assert book.last_off == pytest.approx(1600 / 30)
    assert book.settled == pytest.approx(1600 / 30)
    assert book.off_seconds[0] == pytest.approx(50.0)
    assert book.best_lap == NO_LAP  # the only one noted left the road


def test_a_policy_fails_that_is_off_the_road_for_a_tenth_of_the_last_minute() -> None:
    assert not drive(72.0, 14_000).failed
    assert drive(72.0, 14_000, slice(13_000, 13_180)).failed
    assert not drive(72.0, 14_000, slice(13_000, 13_179)).failed
    assert not drive(72.0, 14_000, slice(12_000, 12_200)).failed  # a minute ago
    assert not drive(72.0, 8_000, slice(7_000, 8_000)).failed  # it still learns to drive


def test_circles_are_not_driving() -> None:
    book = drive(20.0, 12_000, circling=True)
    assert book.clean_speed == 0.0
    assert book.settled == pytest.approx(400.0)
    assert book.best_lap == NO_LAP


def test_a_drive_lasts_until_the_first_minute_in_which_it_fails() -> None:
    def lasting(*off_seconds: float) -> float:
        rows = np.zeros((len(off_seconds), 1800, 5))
        for minute, seconds in zip(rows, off_seconds, strict=True):
            minute[: round(30.0 * seconds), 4] = 1.0
        return Drive(array("d", rows.ravel())).lasted

    assert lasting(0.0, 5.9, 6.0, 0.0) == 180.0
    assert lasting(0.0, 5.9) == 120.0
