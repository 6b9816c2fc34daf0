r"""Driving a racing car round a closed road, in a simulator of our own: TORCS without its installation.

::

        n > 0 (left)                      lookahead
    ------------------------------------------------------ edge
         ___                          _ . '
        |  _]> - - angle     _  . - '
    - - - - - - - - - - - -x- - - - - - - - - - - - - - -  middle line
         distance ->
    ------------------------------------------------------ edge, -1

Actions, observations, rewards, ends and options are those of TORCS: see ``rules.py``. The car is a dynamic bicycle
model (``motion.py``) with the numbers of ``car.py``: where the tyres' grip doesn't suffice, it slides. Beside the road
there is less grip and more resistance, and after 8 m a wall. Roads are random ones by seed, named ones, or lists of
segments (``roads.py``); they are flat and equally wide everywhere.

- *Start:* in the middle of the road and along it, at the speed of the profile, on the start line or anywhere.
- *Hidden state:* distance along the middle line (m), offset to the left of it (m), angle to it (rad), velocity forwards
  and to the left (m/s), turning rate and angle of the front wheels (rad/s, rad), steps driven.
- *Info:* besides these, as ``state``: ``speed`` (km/h), ``position``, ``distance``, ``laps``, ``lap_time`` (s, of the
  last one, 0 before there is one), ``off_road``, and at the end of an episode ``carry_on``.

Source: section 3.4.4 of the thesis; the simulator there is TORCS, which this one is to prepare for.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from typing_extensions import override

from dpsearch.env_kit.drawing.canvas import Frame
from dpsearch.env_kit.env import KernelEnv
from dpsearch.env_kit.task import Task
from dpsearch.env_kit.vector_env import VectorOf
from dpsearch.envs.driving import kernel as rows
from dpsearch.envs.driving.car import Car
from dpsearch.envs.driving.drawing import View, picture, text
from dpsearch.envs.driving.kernel import pack, state_at
from dpsearch.envs.driving.roads import Shape, make_shape
from dpsearch.envs.driving.rules import (
    CONTROL_HZ,
    KMH,
    LONGEST,
    LOOKAHEAD,
    PROFILE,
    STUCK_SECONDS,
    THESIS_OBSERVATIONS,
    Rules,
    driving_rules,
)

WIDTH = 12.0
"""Width of the road (m)."""
NARROWEST = 4.0
"""The narrowest road that there may be (m)."""
TRACE = 3600
"""Number of steps whose places a drawing shows."""
ROOM = 0.8
"""Share of a curve's radius that road and verge may take on its inner side."""


@dataclass(frozen=True, kw_only=True)
class TrackTask(Task):
    """The task of driving on a closed road.

    Attributes:
        shape: The middle line of the road.
        width: Width of the road (m).
        car: The car.
        rules: The rules of the drive.
    """

    shape: Shape
    width: float
    car: Car
    rules: Rules

    @property
    @override
    def mirror_signs(self) -> tuple[float, ...] | None:
        """Those of the rules."""
        return self.rules.mirror_signs

    @override
    def hidden(self, states: NDArray[np.float64]) -> NDArray[Any]:
        """The car's motion, without the rows that are kept for the rules."""
        return states[:, : rows.HIDDEN]

    @override
    def details(self, states: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
        """Entries of ``info`` besides the hidden state: speed, place, laps."""
        return {
            "speed": KMH * states[:, rows.FORWARD],
            "position": states[:, rows.OFFSET] / (0.5 * self.width),
            "distance": states[:, rows.DISTANCE].copy(),
            "laps": states[:, rows.LAPS].astype(np.int64),
            "lap_time": states[:, rows.LAP_TIME].copy(),
            "off_road": ~(np.abs(states[:, rows.OFFSET]) <= 0.5 * self.width),
        }

    @override
    def carry_on(self, states: NDArray[np.float64]) -> dict[str, NDArray[Any]]:
        """Options for the next ``reset``: the place where the car left the road, and the steps driven."""
        return {
            "driven_steps": states[:, rows.DRIVEN].astype(np.int64),
            "distance": states[:, rows.LEFT_AT].copy(),
        }

    def start(self, driven_steps: int, distance: float) -> NDArray[np.float64]:
        """The kernel's state at the start of an episode, by the steps driven before and the place on the road (m)."""
        return state_at(self.kernel, self.rules, driven_steps, distance)


class Track(KernelEnv):
    """A car on a closed road, as drawn above.

    Args:
        track: A seed for a random road of 2 to 4 km, "oval", "circuit", "g-track-2" (of TORCS), or a list of segments:
            ["straight", metres] and ["turn", radius in metres, degrees to the left].
        width: Width of the road (m).
        speed_profile: (start, end, seconds) in km/h, km/h and s: the speed that a controller holds rises from start to
            end over the time driven; a number for a constant speed; None to give throttle and brake to the agent.
        observations: Names of the observations, from speed, steering, position, lookahead, angle, curvature, rays,
            target.
        lookahead: Base (m) and gain (s) of the look-ahead distance, which is base + gain * speed.
        start: "line" for the start line, "random" for anywhere on the road.
        control_hz: Control steps a second.
        stuck_seconds: Time off the road or standing after which the car is stuck and the episode over.
        reward: Reward of a step on the road: "speed", "progress" for the speed along the road, or "centred" for that
            times 1 - position^2.
        max_episode_steps: Steps after which an episode is cut off; 54,000, half an hour, by default.
        render_mode: "rgb_array", "human" (needs pygame), "ansi" (text) or None.

    Raises:
        ValueError: If an argument is not accepted.
    """

    task: TrackTask
    metadata = {"render_modes": ["rgb_array", "human", "ansi"], "render_fps": 30}

    def __init__(
        self,
        track: int | str | Sequence[Any] = 1,
        width: float = WIDTH,
        speed_profile: Sequence[float] | float | None = PROFILE,
        observations: Sequence[str] = THESIS_OBSERVATIONS,
        lookahead: Sequence[float] = LOOKAHEAD,
        start: str = "line",
        control_hz: float = CONTROL_HZ,
        stuck_seconds: float = STUCK_SECONDS,
        reward: str = "speed",
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
    ) -> None:
        rules = (speed_profile, observations, lookahead, start, control_hz, stuck_seconds, reward)
        super().__init__(self.make_task(track, width, *rules, max_episode_steps), render_mode)
        self._trace: deque[tuple[float, float]] = deque(maxlen=TRACE)

    @classmethod
    def make_task(
        cls,
        track: int | str | Sequence[Any] = 1,
        width: float = WIDTH,
        speed_profile: Sequence[float] | float | None = PROFILE,
        observations: Sequence[str] = THESIS_OBSERVATIONS,
        lookahead: Sequence[float] = LOOKAHEAD,
        start: str = "line",
        control_hz: float = CONTROL_HZ,
        stuck_seconds: float = STUCK_SECONDS,
        reward: str = "speed",
        max_episode_steps: int | None = None,
    ) -> TrackTask:
        """The task that the class plays with these arguments."""
        rules = driving_rules(
            speed_profile=speed_profile,
            observations=observations,
            lookahead=lookahead,
            start=start,
            control_hz=control_hz,
            stuck_seconds=stuck_seconds,
            reward=reward,
        )
        return track_task(track, width, rules, LONGEST if max_episode_steps is None else max_episode_steps)

    @override
    def _place(self, options: dict[str, Any] | None) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
        start = self.task.rules.start_of(options, self.task.shape.length)

        def placed(state: NDArray[np.float64]) -> NDArray[np.float64]:
            distance = float(state[rows.DISTANCE]) if start.distance is None else start.distance
            return self.task.start(start.driven_steps, distance)

        return placed

    @override
    def _follow(self) -> None:
        """Remembers the places of the car, if they will be drawn."""
        if self.render_mode in ("rgb_array", "human"):
            if self.elapsed_steps == 0:
                self._trace.clear()
            x, y, _ = self._pose()
            self._trace.append((x, y))

    def _pose(self) -> tuple[float, float, float]:
        """Place of the car on the ground (m) and its heading (rad)."""
        state = self.kernel_state()
        x, y, heading = self.task.shape.at(state[rows.DISTANCE], state[rows.OFFSET])
        return x, y, heading + float(state[rows.ANGLE])

    def view(self) -> View:
        """The present moment, for drawings."""
        state, rules, shape = self.kernel_state(), self.task.rules, self.task.shape
        details = {name: values[0].item() for name, values in self.task.details(state[None]).items()}
        ahead = shape.at(state[rows.DISTANCE] + rules.lookahead_distance(details["speed"]))
        return View(
            title="Track",
            line=np.column_stack([shape.x, shape.y]),
            width=self.task.width,
            car=self._pose(),
            wheels=float(state[rows.WHEELS]),
            lookahead=ahead[:2],
            trace=np.array(self._trace).reshape(-1, 2),
            target=None if rules.profile is None else rules.target_speed(int(state[rows.DRIVEN])),
            lock=self.task.car.lock,
            verge=self.task.car.verge,
            length=shape.length,
            seconds=self.elapsed_steps / rules.control_hz,
            step=self.elapsed_steps,
            max_steps=self.max_episode_steps,
            stuck=bool(state[rows.STUCK_STEPS] >= rules.stuck_steps),
            episode_return=self.episode_return,
            **details,
        )

    def picture(self) -> Frame:
        """The moment as a picture, ``(540, 960, 3)``."""
        return picture(self.view())

    def text(self) -> str:
        """The moment in a few lines of text."""
        return text(self.view())


def track_task(
    track: int | str | Sequence[Any], width: float, rules: Rules, max_episode_steps: int, car: Car | None = None
) -> TrackTask:
    """The task of driving.

    Args:
        track: Road, as in :class:`Track`.
        width: Width of the road (m).
        rules: The rules of the drive.
        max_episode_steps: Steps after which an episode is cut off.
        car: The car; None for the usual one.

    Raises:
        ValueError: If an argument is not accepted, or the road is too wide for the track.
    """
    car = Car() if car is None else car
    if not isinstance(width, int | float) or isinstance(width, bool) or not NARROWEST <= width < math.inf:
        raise ValueError(f"width must be a finite number of metres, at least {NARROWEST:g}, got {width!r}")
    shape = make_shape(track)
    widest = 2.0 * (ROOM * shape.tightest - car.verge)
    if width > widest:
        raise ValueError(
            f"width must leave room for a verge of {car.verge:g} m inside the tightest curve, of radius "
            f"{shape.tightest:.1f} m: at most {widest:.1f} m, got {width!r}"
        )
    if shape.comes_near(width):
        raise ValueError(f"the track must not cross itself, nor come nearer to itself than its width of {width:g} m")
    wall, spin = 0.5 * width + car.verge, np.inf
    high = np.array([shape.length, wall, math.pi, spin, spin, spin, car.lock, spin])
    low = np.array([0.0, -wall, -math.pi, -spin, -spin, -spin, -car.lock, 0.0])
    return TrackTask(
        kernel=pack(shape, width, car, rules),
        observation_space=rules.observation_space,
        action_space=rules.action_space,
        state_space=spaces.Box(low, high, dtype=np.float64),
        max_episode_steps=max_episode_steps,
        shape=shape,
        width=float(width),
        car=car,
        rules=rules,
    )


class TrackVector(VectorOf):
    """Many :class:`Track`."""

    scalar = Track
    task: TrackTask
