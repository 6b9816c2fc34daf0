"""Pictures of a car on a road, seen from above: all of the track, and what is around the car; and a sketch in text."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpsearch.env_kit.drawing import palette
from dpsearch.env_kit.drawing.canvas import Canvas, Frame, Point
from dpsearch.env_kit.drawing.scene import MARGIN, WIDTH, Card, Message, stage

Array = NDArray[np.float64]

_TOP, _HEIGHT = 110, 300  # top and height of the drawing, between the words above and the cards below
_MAP, _GAP = 360, 16  # width of the map, and of the gap between it and the close-up
_CLOSE_UP = WIDTH - 2 * round(MARGIN) - _MAP - _GAP
_SCALE = 5.0  # pixels to the metre in the close-up
_BEHIND = 0.28  # share of the close-up that is behind the car
_CAR = (4.6, 2.0)  # length and width of the car (m)
_AXLES = (1.35, -1.15)  # places of the axles, from the middle of the car (m)
_GRASS, _ROAD = palette.mix(palette.MINT, palette.GREEN, 0.18), palette.mix(palette.INK, palette.LINE, 0.45)
_WALL = palette.mix(_GRASS, palette.INK, 0.55)
_TEXT_CELLS = 41  # characters from edge to edge of the road


@dataclass(frozen=True, kw_only=True)
class View:
    """The present moment of a drive, as drawings need it.

    Attributes:
        title: The task's name.
        line: The middle of the road (m), ``(K, 2)``, closed.
        width: Width of the road (m), one number or ``(K,)``.
        car: Place (m, m) and heading (rad) of the car.
        wheels: Angle of the front wheels (rad), positive to the left.
        lock: Largest angle of the front wheels (rad).
        verge: Width of the strip beside the road, up to a wall (m); None if there is no wall.
        lookahead: The middle of the road at the look-ahead distance (m, m).
        trace: Places where the car has been (m), ``(T, 2)``, the present one included.
        speed: Speed of the car (km/h).
        target: Speed that is to be held (km/h), or None.
        position: Distance from the middle of the road, in half widths, positive to the left.
        distance: Distance along the middle line (m).
        length: Length of the middle line (m).
        laps: Number of completed laps.
        lap_time: Time of the last completed lap (s), 0 before there is one.
        off_road: Whether the car is off the road.
        stuck: Whether the car is stuck.
        seconds: Time since the episode began (s).
        step: Steps so far.
        max_steps: Steps at which the episode is cut off.
        episode_return: Sum of rewards so far.
    """

    title: str
    line: Array
    width: float | Array
    car: tuple[float, float, float]
    wheels: float
    lock: float
    verge: float | None
    lookahead: tuple[float, float]
    trace: Array
    speed: float
    target: float | None
    position: float
    distance: float
    length: float
    laps: int
    lap_time: float
    off_road: bool
    stuck: bool
    seconds: float
    step: int
    max_steps: int
    episode_return: float

    @property
    def aim(self) -> str:
        """The aim in words, for people who have never heard of the task."""
        if self.target is None:
            return "Drive as fast as the road allows."
        return "Steer, and stay on the road while the speed rises."

    def message(self) -> Message:
        """Sentence about the moment."""
        if self.stuck:
            return Message(f"Stuck off the road, after {clock(self.seconds)}.", palette.RED)
        if self.off_road:
            side = "left" if self.position > 0.0 else "right"
            return Message(f"Off the road, to its {side}.", palette.RED)
        if self.step == 0:
            return Message("The start.")
        if self.step >= self.max_steps:
            return Message("The end of the drive.", palette.GREEN)
        lap = f", the last lap in {clock(self.lap_time)}" if self.laps else ""
        return Message(f"On the road for {clock(self.seconds)}{lap}.")


def clock(seconds: float) -> str:
    """A time in minutes and seconds."""
    minutes, rest = divmod(round(10.0 * seconds), 600)
    return f"{minutes}:{rest / 10.0:04.1f} min" if minutes else f"{rest / 10.0:.1f} s"


def picture(view: View) -> Frame:
    """A picture of the moment, ``(HEIGHT, WIDTH, 3)``."""
    canvas = stage(view.title, view.aim, view.message(), _cards(view))
    canvas.text((WIDTH - MARGIN, 88), f"return {view.episode_return:z,.0f}", 17, palette.FAINT, "rm")
    canvas.text((MARGIN, 525), f"{view.step:,} of {view.max_steps:,} steps", 14, palette.FAINT)
    left = round(MARGIN)
    canvas.paste((left, _TOP), _map(view))
    canvas.paste((left + _MAP + _GAP, _TOP), _close_up(view))
    return canvas.frame()


def _edges(view: View, beyond: float = 0.0) -> tuple[Array, Array]:
    """Lines left and right of the road, at its edges or ``beyond`` them (m), ``(K, 2)`` each."""
    along = np.roll(view.line, -1, axis=0) - np.roll(view.line, 1, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    half = beyond + 0.5 * np.broadcast_to(view.width, len(view.line))
    aside = half[:, None] * np.column_stack([-along[:, 1], along[:, 0]])
    return view.line + aside, view.line - aside


def _map(view: View) -> Canvas:
    """Draws the whole track, north above."""
    canvas = Canvas(_MAP, _HEIGHT)
    canvas.box((0, 0), (_MAP, _HEIGHT), _GRASS)
    low, high = view.line.min(axis=0), view.line.max(axis=0)
    scale = min((_MAP - 40.0) / max(high[0] - low[0], 1.0), (_HEIGHT - 40.0) / max(high[1] - low[1], 1.0))
    middle = (low + high) / 2.0

    def at(places: Array) -> list[Point]:
        x = _MAP / 2 + scale * (places[:, 0] - middle[0])
        y = _HEIGHT / 2 - scale * (places[:, 1] - middle[1])
        return list(zip(x.tolist(), y.tolist(), strict=True))

    few = view.line[:: max(1, len(view.line) // 600)]
    canvas.path(at(few), palette.WHITE, max(7.0, scale * float(np.mean(view.width)) + 2.0), closed=True)
    canvas.path(at(few), _ROAD, max(5.0, scale * float(np.mean(view.width))), closed=True)
    left, right = _edges(view)
    ends = at(np.stack([left[0], right[0]]) + 2.5 * (np.stack([left[0], right[0]]) - view.line[0]))
    canvas.line(ends[0], ends[1], palette.INK, 2)
    if len(view.trace) > 1:
        canvas.path(at(view.trace[:: max(1, len(view.trace) // 600)]), palette.GOLD, 2)
    place = at(np.array([view.car[:2]]))[0]
    canvas.disc(place, 7, palette.RED if view.off_road else palette.ORANGE, palette.WHITE)
    return canvas


def _close_up(view: View) -> Canvas:
    """Draws the surroundings of the car, which heads to the right."""
    canvas = Canvas(_CLOSE_UP, _HEIGHT)
    canvas.box((0, 0), (_CLOSE_UP, _HEIGHT), _GRASS)
    x, y, heading = view.car
    forwards, leftwards = (math.cos(heading), math.sin(heading)), (-math.sin(heading), math.cos(heading))

    def at(places: Array) -> list[Point]:
        relative = np.atleast_2d(places) - (x, y)
        right = _BEHIND * _CLOSE_UP + _SCALE * (relative @ np.array(forwards))
        down = _HEIGHT / 2 - _SCALE * (relative @ np.array(leftwards))
        return list(zip(right.tolist(), down.tolist(), strict=True))

    left, right = (at(edge) for edge in _edges(view))
    near = np.linalg.norm(view.line - (x, y), axis=1) < 1.2 * _CLOSE_UP / _SCALE
    for wall in () if view.verge is None else (at(wall) for wall in _edges(view, view.verge)):
        for i in np.flatnonzero(near).tolist():
            canvas.line(wall[i], wall[(i + 1) % len(wall)], _WALL, 4)
    for i in np.flatnonzero(near).tolist():
        j = (i + 1) % len(view.line)
        canvas.polygon([left[i], left[j], right[j], right[i]], _ROAD)
    middle = at(view.line)
    for i in np.flatnonzero(near).tolist():
        j = (i + 1) % len(view.line)
        for edge in (left, right):
            canvas.line(edge[i], edge[j], palette.WHITE, 2.5)
        if i % 8 < 3:
            canvas.line(middle[i], middle[j], palette.LINE, 1.5)
    if near[0]:
        canvas.line(left[0], right[0], palette.WHITE, 5)
    recent = view.trace[np.linalg.norm(view.trace - (x, y), axis=1) < 1.2 * _CLOSE_UP / _SCALE]
    if len(recent) > 1:
        canvas.path(at(recent), palette.GOLD, 2.5)
    target = at(np.array(view.lookahead))[0]
    here = (_BEHIND * _CLOSE_UP, _HEIGHT / 2)
    canvas.dashes(here, target, palette.SKY, 2, 14)
    canvas.disc(target, 5, palette.SKY, palette.WHITE)
    _car(canvas, here, view)
    canvas.line((14, _HEIGHT - 14), (14 + 10 * _SCALE, _HEIGHT - 14), palette.INK, 2)
    canvas.text((14, _HEIGHT - 24), "10 m", 13)
    return canvas


def _car(canvas: Canvas, here: Point, view: View) -> None:
    """Draws the car from above, heading to the right, with its front wheels as they are steered."""

    def at(along: float, across: float, turn: float = 0.0, middle: Point = (0.0, 0.0)) -> Point:
        cos, sin = math.cos(turn), math.sin(turn)
        forwards, left = middle[0] + along * cos - across * sin, middle[1] + along * sin + across * cos
        return here[0] + _SCALE * forwards, here[1] - _SCALE * left

    def block(length: float, width: float, color: str, turn: float = 0.0, middle: Point = (0.0, 0.0)) -> None:
        sides = ((1, 1), (1, -1), (-1, -1), (-1, 1))
        canvas.polygon([at(a * length / 2, b * width / 2, turn, middle) for a, b in sides], color)

    for axle, turn in zip(_AXLES, (view.wheels, 0.0), strict=True):
        for side in (-1.0, 1.0):
            block(0.9, 0.45, palette.INK, turn, (axle, side * _CAR[1] * 0.47))
    body = palette.RED if view.off_road else palette.ORANGE
    length, width = _CAR
    nose = [(0.5, 0.22), (0.5, -0.22), (0.36, -0.46), (-0.46, -0.5), (-0.5, -0.4), (-0.5, 0.4), (-0.46, 0.5)]
    canvas.polygon([at(a * length, b * width) for a, b in [*nose, (0.36, 0.46)]], body)
    block(1.3, 1.3, palette.NIGHT, 0.0, (-0.2, 0.0))
    block(0.35, 2.0, palette.INK, 0.0, (-2.15, 0.0))


def _cards(view: View) -> list[Card]:
    fill, color = (palette.ROSE, palette.RED) if view.off_road else (palette.WHITE, palette.INK)
    asked = "your own" if view.target is None else f"to hold: {view.target:.1f} km/h"
    last = f"last: {clock(view.lap_time)}" if view.laps else "none completed"
    where = "beside the road" if view.off_road else _side(view.position)
    return [
        Card("speed", f"{view.speed:z.1f} km/h", asked),
        Card("position", f"{view.position:+z.2f}", where, fill=fill, color=color),
        Card("steering", f"{math.degrees(view.wheels):+z.1f}°", f"{view.wheels / view.lock:+z.0%} of the lock"),
        Card("distance", f"{view.distance:z,.0f} m", f"of {view.length:,.0f} m"),
        Card("laps", f"{view.laps}", last),
    ]


def _side(position: float) -> str:
    if abs(position) < 0.05:
        return "in the middle"
    return f"{abs(position):.0%} of the way {'left' if position > 0.0 else 'right'}"


def text(view: View) -> str:
    """A sketch of the moment in a few lines: the road across, its left side at the left."""
    marks = [" "] * (_TEXT_CELLS + 8)
    marks[4], marks[-5], marks[4 + _TEXT_CELLS // 2] = "|", "|", ":"
    cell = round(4 + _TEXT_CELLS / 2 - view.position * _TEXT_CELLS / 2)
    marks[min(max(cell, 0), len(marks) - 1)] = "A"
    asked = "" if view.target is None else f" (to hold: {view.target:.1f})"
    wheels = f"{math.degrees(view.wheels):+z.1f}°"
    return "\n".join(
        [
            f"{''.join(marks)}  {view.message()[0]}",
            f" {view.speed:z.1f} km/h{asked}, position {view.position:+z.2f}, wheels {wheels}",
            f" {view.distance:z,.0f} of {view.length:,.0f} m, {view.laps} laps",
            f" {view.step:,} of {view.max_steps:,} steps, return {view.episode_return:z,.0f}",
        ]
    )
