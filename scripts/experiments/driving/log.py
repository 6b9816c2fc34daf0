"""The log of a drive, step by step, and the metrics computed from it."""

from __future__ import annotations

from array import array
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

STEPS_A_MINUTE = 1800  # 30 a second
WORN_IN = 300.0  # s, before which a policy cannot fail: it still learns to stay on the road
FAILED = 6.0  # s a minute off the road
NO_LAP = 1800.0  # s: counts as the lap time of a car that completes none, the thesis's half hour

SETTLED, WITHIN, FOR_GOOD, OFF, CLEAN, LAP, WALL = "settled", "within", "for_good", "off", "clean", "lap", "wall"
FAILS, UNSEEN, CURVE = "fails", "unseen", "off_seconds"
"""Keys of an outcome."""


class Logbook(gym.Wrapper[Any, Any, Any, Any]):
    """Notes speed, position, distance, lap time and whether the car is off the road, at every step.

    Args:
        env: A driving environment.
        rows: Takes the numbers, five a step, over all episodes.
    """

    def __init__(self, env: gym.Env[Any, Any], rows: array[float]) -> None:
        super().__init__(env)
        self._rows = rows

    def step(self, action: Any) -> Any:
        """One step, and its line in the book."""
        told = self.env.step(action)
        info = told[4]
        self._rows.extend((info["speed"], info["position"], info["distance"], info["lap_time"], info["off_road"]))
        return told


class Drive:
    """A drive of T steps.

    Args:
        rows: The numbers that ``Logbook`` noted.

    Attributes:
        speed: ``(T,)`` km/h.
        position: ``(T,)`` half widths from the middle, positive to the left.
        distance: ``(T,)`` metres from the start line.
        lap_time: ``(T,)`` s, of the last lap; 0 before there is one.
        off_road: ``(T,)`` whether it was off the road.
    """

    def __init__(self, rows: array[float]) -> None:
        table = np.frombuffer(rows, np.float64).reshape(-1, 5)
        self.speed, self.position, self.distance, self.lap_time = table[:, :4].T
        self.off_road: NDArray[np.bool_] = table[:, 4] > 0.0

    @property
    def off_seconds(self) -> list[float]:
        """Seconds off the road in each minute."""
        minutes = np.array_split(self.off_road, range(STEPS_A_MINUTE, len(self.off_road), STEPS_A_MINUTE))
        return [float(minute.sum()) / 30.0 for minute in minutes]

    @property
    def last_off(self) -> float:
        """Time at which the car was off the road for the last time (s); 0 if it never was."""
        off = np.flatnonzero(self.off_road)
        return float(off[-1] + 1) / 30.0 if len(off) else 0.0

    @property
    def settled(self) -> float:
        """Time at which the first five clean minutes on end begin (s); the length of the drive if there are none."""
        clean, _ = self._clean(5 * STEPS_A_MINUTE)
        begins = np.flatnonzero(clean)
        return float(begins[0] if len(begins) else len(self.speed)) / 30.0

    @property
    def clean_speed(self) -> float:
        """The highest mean speed of a clean minute (km/h); 0 for none."""
        clean, ways = self._clean(STEPS_A_MINUTE)
        return float(np.where(clean, ways, 0.0).max(initial=0.0)) / 60.0 * 3.6

    @property
    def failed(self) -> bool:
        """Whether the policy has failed: the last minute was off the road for a tenth, long after learning began."""
        off = self.off_road[-STEPS_A_MINUTE:]
        return len(self.off_road) >= 30.0 * WORN_IN and float(off.sum()) / 30.0 >= FAILED

    @property
    def lasted(self) -> float:
        """Time by which a policy that does not learn has failed (s), in whole minutes; the drive's length if never."""
        ends = [60.0 * (minute + 1) for minute, off in enumerate(self.off_seconds) if off >= FAILED]
        return min([*ends, len(self.speed) / 30.0])

    def _clean(self, step: int) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        """Whether so many steps from each on are clean, and the way driven in them (m).

        They are if the car doesn't leave the road and nine tenths of its way are got ahead along it: no circles.
        """
        length = max(float(self.distance.max()), 1.0)
        moves = np.diff(self.distance, prepend=self.distance[:1])
        along = np.concatenate([[0.0], np.cumsum(moves - length * np.round(moves / length))])
        driven = np.concatenate([[0.0], np.cumsum(self.speed / 3.6 / 30.0)])
        off = np.concatenate([[0], np.cumsum(self.off_road)])
        ways, ahead = driven[step:] - driven[:-step], along[step:] - along[:-step]
        return (off[step:] == off[:-step]) & (ahead >= 0.9 * ways), ways

    @property
    def best_lap(self) -> float:
        """Time of the fastest lap that did not leave the road (s); NO_LAP for none."""
        times = [NO_LAP]
        for end in np.flatnonzero(np.diff(self.lap_time, prepend=0.0)):
            steps = round(30.0 * self.lap_time[end])
            if steps and not self.off_road[end + 1 - steps : end + 1].any():
                times.append(float(self.lap_time[end]))
        return min(times)
