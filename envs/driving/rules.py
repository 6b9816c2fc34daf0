"""The rules of driving on a road, which the embedded track and the real TORCS share: numbers and rules, no simulator.

The car of section 3.4.4 of the thesis: a network steers 30 times a second while a preprogrammed controller holds a
speed that rises linearly from 10 km/h to 70 km/h in 30 minutes.

- *Action:* steering in [-1, 1], where the front wheels shall point, as a fraction of the lock, positive to the left;
  without a speed profile the pedals too: throttle above 0, brake below.
- *Observations*, each shifted and scaled by fixed constants to about mean 0 and deviation 1 under a decent driver:
  ``speed``, ``steering`` (where the front wheels point now), ``position`` on the road (0 in the middle, 1 at the left
  edge, -1 at the right one) and ``lookahead``. The thesis's fourth input is called a look-ahead distance that varies
  linearly with speed. A function of the speed alone would say nothing of the road, so it is read as what is seen at
  that distance: the bearing, relative to the car's heading, of the middle of the road so far ahead along the road.
  On request: ``angle`` (of the car relative to the road), ``curvature`` (of the road at the look-ahead distance),
  ``rays`` (free road in nine directions) and ``target`` (what the profile asks for). No bias: networks have their own.
- *Reward* of a step: the speed in km/h. Off the road -100 instead. A car that has been off the road, or stood, as it
  does with its nose against a wall, for ``stuck_seconds`` on end is stuck: -1000 and the end of the episode. The thesis
  does not say when a car counts as stuck, nor whether penalties come on top of the speed; they do not here, so that
  nothing can be earned off the road. It is the speed wherever one goes: while the car is slow, circles within the road
  pay as well as laps. With the option ``reward="progress"`` it is the speed along the road, which they do not have;
  with ``reward="centred"`` the share 1 - position^2 of that, so that there is something to lose before the edge.
- *Afterwards* the car is put back on the road where it left it, and the speed goes on from where it was: the last
  ``info`` of an episode has ``carry_on``, the options with which the next ``reset`` does that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

CONTROL_HZ: Final = 30.0
"""Steps a second."""
KMH: Final = 3.6
"""Kilometres an hour in a metre a second."""
OFF_ROAD_REWARD: Final = -100.0
STUCK_REWARD: Final = -1000.0
STUCK_SECONDS: Final = 5.0
STANDING: Final = 1.0
"""Below this speed a car stands (km/h)."""
LONGEST: Final = 54_000
"""Steps of an episode: 30 minutes."""
PEDALS_START: Final = 10.0
"""Speed at which an episode starts if the agent has the pedals (km/h)."""
LOOKAHEAD: Final = (10.0, 1.0)
"""Base (m) and gain (s) of the look-ahead distance."""
PROFILE: Final = (10.0, 70.0, 1800.0)
"""The thesis's speed profile: km/h, km/h, s."""
SLOWEST: Final = 2.0
"""The lowest speed that a profile may ask for (km/h): at 1 km/h a car counts as standing."""
FASTEST: Final = 400.0
"""The highest speed that a profile may ask for (km/h)."""
RAY_ANGLES: Final = tuple(math.radians(angle) for angle in range(-60, 61, 15))
"""Directions of the rays relative to the car's heading, from right to left (rad)."""
RAY_LENGTH: Final = 100.0
"""Range of the rays (m)."""
STARTS: Final = ("line", "random")
REWARDS: Final = ("speed", "progress", "centred")
"""Rewards of a step on the road (km/h): the speed of the car; its speed along the road; the latter times
1 - position^2."""


class Scale(NamedTuple):
    """The scale on which a quantity is observed: ``(value - mean) / deviation``.

    Attributes:
        mean: Mean of the quantity under a decent driver over the thesis's speed profile.
        deviation: Standard deviation of the quantity under that driver.
        size: Number of numbers in the quantity.
        mirrored: The sign by which a mirror multiplies it; None for numbers that change places in a mirror.
    """

    mean: float
    deviation: float
    size: int = 1
    mirrored: float | None = -1.0


OBSERVATIONS: Final[Mapping[str, Scale]] = {
    "speed": Scale(40.0, 17.3, mirrored=1.0),  # km/h: mean and deviation of the profile, (70 - 10) / sqrt(12)
    "steering": Scale(0.0, 0.04),  # fraction of the lock
    "position": Scale(0.0, 0.2),  # half widths of the road
    "lookahead": Scale(0.0, 0.12),  # rad
    "angle": Scale(0.0, 0.05),  # rad
    "curvature": Scale(0.0, 0.008),  # 1/m
    "rays": Scale(20.0, 23.0, len(RAY_ANGLES), mirrored=None),  # m
    "target": Scale(40.0, 17.3, mirrored=1.0),  # km/h
}
"""All observations. Their scales were measured with an unsteady hand that heads for the look-ahead point, on random
tracks. On TORCS' e-track-1 and g-track-2, from 10 to 70 km/h, the thesis's four have means from 0.0 to 0.2, deviations
from 0.7 to 1.2 under the same hand. A steady one stays nearer to the middle: positions deviate by 0.2 to 0.4."""
THESIS_OBSERVATIONS: Final = ("speed", "steering", "position", "lookahead")


@dataclass(frozen=True)
class SpeedProfile:
    """The speed that a preprogrammed controller holds: linear over the time driven, then constant.

    Attributes:
        start: First speed (km/h).
        end: Last speed (km/h).
        seconds: Time from the first speed to the last (s).
    """

    start: float
    end: float
    seconds: float

    def speed(self, driven_seconds: float) -> float:
        """The speed (km/h) after so many seconds of driving."""
        return self.start + (self.end - self.start) * min(driven_seconds / self.seconds, 1.0)


class Start(NamedTuple):
    """The start of an episode.

    Attributes:
        driven_steps: Number of steps driven in the episodes before.
        distance: Place on the middle line (m); None for the environment's own start.
    """

    driven_steps: int
    distance: float | None


@dataclass(frozen=True, kw_only=True)
class Rules:
    """The rules of a drive: speed, observations, limits, rewards; :func:`driving_rules` checks the numbers.

    Attributes:
        profile: Speed that the controller holds; None if the agent has the pedals.
        observations: Names of the observations, in this order.
        lookahead: Base (m) and gain (s) of the look-ahead distance, ``base + gain * speed``.
        start: "line", or "random" for anywhere on the road.
        control_hz: Control steps a second.
        stuck_seconds: Time off the road or standing after which the car is stuck.
        reward: Reward of a step on the road, one of ``REWARDS``.
    """

    profile: SpeedProfile | None
    observations: tuple[str, ...]
    lookahead: tuple[float, float]
    start: str
    control_hz: float
    stuck_seconds: float
    reward: str = "speed"

    @property
    def stuck_steps(self) -> int:
        """Number of successive steps off the road or standing at which the episode ends."""
        return max(1, round(self.stuck_seconds * self.control_hz))

    @property
    def observation_space(self) -> spaces.Box:
        """Space of observations, as a flat box."""
        size = sum(OBSERVATIONS[name].size for name in self.observations)
        return spaces.Box(-np.inf, np.inf, (size,), np.float32)

    @property
    def action_space(self) -> spaces.Box:
        """Space of actions: steering, and the pedals if there is no profile."""
        return spaces.Box(-1.0, 1.0, (2 if self.profile is None else 1,), np.float32)

    @property
    def mirror_signs(self) -> tuple[float, ...] | None:
        """The signs by which a mirror multiplies each number observed, then steering and pedals; None with rays."""
        seen = [OBSERVATIONS[name].mirrored for name in self.observations]
        signs = [sign for sign in seen if sign is not None]
        pedals = self.profile is None
        return (*signs, -1.0, *[1.0] * pedals) if len(signs) == len(seen) else None

    def target_speed(self, driven_steps: int) -> float:
        """Speed to be held (km/h) after so many steps; with pedals the speed at which episodes start."""
        return PEDALS_START if self.profile is None else self.profile.speed(driven_steps / self.control_hz)

    def lookahead_distance(self, speed: float) -> float:
        """The look-ahead distance (m) at a speed in km/h, never negative."""
        return self.lookahead[0] + self.lookahead[1] * max(speed, 0.0) / KMH

    def show(self, seen: Mapping[str, float | Sequence[float]]) -> NDArray[np.float32]:
        """The observation, from quantities by name in the units of ``OBSERVATIONS``."""
        parts = [(np.atleast_1d(seen[name]) - scale.mean) / scale.deviation for name, scale in self._scales()]
        return np.concatenate(parts).astype(np.float32)

    def _scales(self) -> list[tuple[str, Scale]]:
        return [(name, OBSERVATIONS[name]) for name in self.observations]

    def start_of(self, options: Mapping[str, Any] | None, length: float) -> Start:
        """The start that the options of ``reset`` ask for.

        Args:
            options: Options ``driven_steps`` and ``distance``, or one of them; None for neither.
            length: Length of the road's middle line (m).

        Raises:
            ValueError: If there are other options, or a number is out of range.
        """
        options = options or {}
        unknown = sorted(set(options) - {"driven_steps", "distance"})
        if unknown:
            raise ValueError(f"options of reset may be driven_steps and distance, got {', '.join(map(str, unknown))}")
        driven, distance = options.get("driven_steps", 0), options.get("distance")
        if isinstance(driven, bool) or not isinstance(driven, int | np.integer) or driven < 0:
            raise ValueError(f"driven_steps must be a whole number, at least 0, got {driven!r}")
        if distance is not None and not (_is_number(distance) and 0.0 <= distance <= length):
            raise ValueError(f"distance must be from 0 to the road's {length:.1f} m, got {distance!r}")
        return Start(int(driven), None if distance is None else float(distance))


def driving_rules(
    *,
    speed_profile: Any = PROFILE,
    observations: Sequence[str] = THESIS_OBSERVATIONS,
    lookahead: Sequence[float] = LOOKAHEAD,
    start: str = "line",
    control_hz: float = CONTROL_HZ,
    stuck_seconds: float = STUCK_SECONDS,
    reward: str = "speed",
) -> Rules:
    """Rules from the options of an environment.

    Args:
        speed_profile: (start, end, seconds) in km/h (2 to 400) and s; a number for a constant speed; None for pedals.
        observations: Names from ``OBSERVATIONS``, each at most once.
        lookahead: Base (m) and gain (s) of the look-ahead distance.
        start: "line" or "random".
        control_hz: Steps a second, from 10 to 200.
        stuck_seconds: Time off the road or standing after which the car is stuck, positive.
        reward: "speed", "progress" for the speed along the road, or "centred" for that times 1 - position^2.

    Raises:
        ValueError: If an argument is not accepted.
    """
    names = [observations] if isinstance(observations, str) else list(observations)
    if not names or len(set(names)) < len(names) or not set(names) <= set(OBSERVATIONS):
        raise ValueError(f"observations must be some of {', '.join(OBSERVATIONS)}, each once, got {observations!r}")
    if "target" in names and speed_profile is None:
        raise ValueError("observations can't have target without a speed_profile")
    ahead = _numbers(lookahead, 2)
    if ahead is None or not (0.0 < ahead[0] <= 200.0 and 0.0 <= ahead[1] <= 10.0):
        raise ValueError(f"lookahead must be a base in (0, 200] m and a gain in [0, 10] s, got {lookahead!r}")
    if start not in STARTS:
        raise ValueError(f"start must be one of {', '.join(STARTS)}, got {start!r}")
    if not (_is_number(control_hz) and 10.0 <= control_hz <= 200.0):
        raise ValueError(f"control_hz must be from 10 to 200, got {control_hz!r}")
    if not (_is_number(stuck_seconds) and 0.0 < stuck_seconds < math.inf):
        raise ValueError(f"stuck_seconds must be finite and positive, got {stuck_seconds!r}")
    if reward not in REWARDS:
        raise ValueError(f"reward must be one of {', '.join(REWARDS)}, got {reward!r}")
    return Rules(
        profile=_profile(speed_profile),
        observations=tuple(names),
        lookahead=(ahead[0], ahead[1]),
        start=start,
        control_hz=float(control_hz),
        stuck_seconds=float(stuck_seconds),
        reward=reward,
    )


def _profile(given: Any) -> SpeedProfile | None:
    if given is None:
        return None
    numbers = (float(given), float(given), 1.0) if _is_number(given) else _numbers(given, 3)
    if numbers is None or not (all(SLOWEST <= v <= FASTEST for v in numbers[:2]) and 0.0 < numbers[2] < math.inf):
        held = f"[{SLOWEST:g}, {FASTEST:g}]"
        raise ValueError(
            f"speed_profile must be start and end in {held} km/h and positive seconds from the one to the other, a "
            f"number in {held} for a constant speed, or None for the pedals, got {given!r}"
        )
    return SpeedProfile(*numbers)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)


def _numbers(values: Any, count: int) -> tuple[float, ...] | None:
    """So many numbers; None if these are others."""
    if isinstance(values, str | Mapping) or not hasattr(values, "__len__") or len(values) != count:
        return None
    return tuple(float(value) for value in values) if all(map(_is_number, values)) else None


@dataclass
class Referee:
    """Rewards, ends and laps of one episode after another, from where the car is after each step.

    A lap is complete each time the car has got further by the length of the road than ever before in the episode.

    Attributes:
        rules: The rules of the drive.
        length: Length of the road's middle line (m).
        driven_steps: Number of steps driven, those before the episode included.
        progress: Distance along the middle line since the episode began (m); backwards counts as negative.
        laps: Number of laps completed in the episode.
        lap_time: Time of the last completed lap (s), 0 before there is one (a NaN would be unequal to itself).
        off_road: Whether the car is off the road.
    """

    rules: Rules
    length: float
    driven_steps: int = 0
    progress: float = 0.0
    laps: int = 0
    lap_time: float = 0.0
    off_road: bool = False
    _distance: float = field(default=0.0, repr=False)
    _left_at: float = field(default=0.0, repr=False)
    _lap_began: int = field(default=0, repr=False)
    _stuck_steps: int = field(default=0, repr=False)

    def reset(self, driven_steps: int, distance: float) -> None:
        """Begins an episode with the car in the middle of the road at a distance (m) along it."""
        self.driven_steps = self._lap_began = driven_steps
        self._distance = self._left_at = distance
        self.progress, self.laps, self.lap_time, self.off_road, self._stuck_steps = 0.0, 0, 0.0, False, 0

    def step(self, speed: float, position: float, distance: float, progress: float | None = None) -> tuple[float, bool]:
        """Judges a step.

        Args:
            speed: Speed after the step (km/h).
            position: Distance from the middle of the road, in half widths.
            distance: Distance along the middle line (m), which begins anew with every lap.
            progress: Speed along the road (km/h), needed if the reward depends on it.

        Returns:
            The reward, and whether the car is stuck.
        """
        self.driven_steps += 1
        self.progress += math.remainder(distance - self._distance, self.length)  # the shorter way round
        self._distance = distance
        if self.progress >= (self.laps + 1) * self.length:
            self.laps += 1
            self.lap_time = (self.driven_steps - self._lap_began) / self.rules.control_hz
            self._lap_began = self.driven_steps
        self.off_road = not abs(position) <= 1.0  # also if it is not a number
        self._stuck_steps = self._stuck_steps + 1 if self.off_road or not speed >= STANDING else 0
        if not self.off_road:
            self._left_at = distance
        if self._stuck_steps >= self.rules.stuck_steps:
            return STUCK_REWARD, True
        if self.off_road:
            return OFF_ROAD_REWARD, False
        if self.rules.reward == "speed" or progress is None:
            return speed, False
        return (progress * (1.0 - position**2) if self.rules.reward == "centred" else progress), False

    def info(self, speed: float, position: float) -> dict[str, Any]:
        """Entries of a step's ``info`` besides the state: speed in km/h, position in half widths."""
        return {
            "speed": speed,
            "position": position,
            "distance": self._distance,
            "laps": self.laps,
            "lap_time": self.lap_time,
            "off_road": self.off_road,
        }

    def carry_on(self) -> dict[str, Any]:
        """The options of ``reset`` that put the car back where it left the road and let the profile go on."""
        return {"driven_steps": self.driven_steps, "distance": self._left_at}
