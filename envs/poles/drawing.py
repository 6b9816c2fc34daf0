"""Pictures of carts that balance poles, to scale, and a sketch of them in text."""

from __future__ import annotations

import math
from dataclasses import dataclass

from dpsearch.env_kit.drawing import palette
from dpsearch.env_kit.drawing.canvas import Canvas, Frame, Point
from dpsearch.env_kit.drawing.scene import MARGIN, WIDTH, Card, Message, stage

_METRE = 150.0  # pixels
_MIDDLE, _GROUND = WIDTH / 2, 362.0  # the middle of the track, and the height of the rails
_CART_WIDTH, _CART_HEIGHT, _WHEEL = 84.0, 34.0, 9.0
_HINGES = ((0.0,), (-17.0, 20.0))  # where on the cart the poles stand, for one pole and for two
_LENGTHS = (1.0, 0.1)  # lengths of the poles, in metres
_WIDTHS = (9.0, 7.0)
_COLORS = (palette.ORANGE, palette.BLUE)
_SECONDS = 0.02  # s, the time that an action lasts
_TEXT_CELLS = 48  # characters between the ends of the track


@dataclass(frozen=True)
class View:
    """The present moment of balancing, as drawings need it.

    Attributes:
        state: The state x, v, a_1, w_1 (and a_2, w_2), in metres, radians and seconds.
        scales: Divisors of the numbers of the state before the agent sees them.
        velocities: Whether the agent is shown v and w.
        track: Largest distance of the cart from the middle (m).
        lean: Largest angle of a pole (rad).
        force: Force on the cart during the last step (N), or None.
        step: Steps so far.
        max_steps: Steps at which the episode is cut off.
        episode_return: Sum of rewards so far.
    """

    state: tuple[float, ...]
    scales: tuple[float, ...]
    velocities: bool
    track: float
    lean: float
    force: float | None
    step: int
    max_steps: int
    episode_return: float

    @property
    def angles(self) -> tuple[float, ...]:
        """Angles of the poles, in radians from upright to the right."""
        return self.state[2::2]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the poles."""
        return ("pole",) if len(self.angles) == 1 else ("long pole", "short pole")

    @property
    def fallen(self) -> tuple[bool, ...]:
        """The poles that lean too far."""
        return tuple(not abs(angle) <= self.lean for angle in self.angles)

    @property
    def off_the_track(self) -> bool:
        """Whether the cart is beyond an end of the track."""
        return not abs(self.state[0]) <= self.track

    @property
    def title(self) -> str:
        """The task's name."""
        return "Two poles" if len(self.angles) == 2 else "One pole"

    @property
    def aim(self) -> str:
        """The aim in words, for people who have never heard of the task."""
        what = "both poles upright" if len(self.angles) == 2 else "the pole upright"
        blind = "" if self.velocities else " Velocities are not shown."
        return f"Push the cart to keep {what} and stay on the track.{blind}"

    @property
    def time(self) -> str:
        """Time since the episode began, in words."""
        return f"{self.step:,} of {self.max_steps:,} steps, {self.step * _SECONDS:.2f} s"

    def message(self) -> Message:
        """Sentence about the moment."""
        for name, down in zip(self.names, self.fallen, strict=True):
            if down:
                degrees = round(math.degrees(self.lean))
                return Message(f"The {name} leans by more than {degrees}°: it fell in step {self.step}.", palette.RED)
        if self.off_the_track:
            return Message(f"The cart has left the track in step {self.step}.", palette.RED)
        if self.step >= self.max_steps:
            return Message("Balanced to the end.", palette.GREEN)
        if self.force is None:
            return Message("The start." if any(self.state[1::2]) else "The start: everything is at rest.")
        return Message(f"Balanced for {self.step:,} step{'s' * (self.step != 1)}, {self.step * _SECONDS:.2f} seconds.")

    def readings(self) -> list[tuple[str, str, str | None]]:
        """Name and value of each number of the state, and its observation: None if it is hidden."""
        names = ("cart", *self.names)
        readings: list[tuple[str, str, str | None]] = []
        for i, (value, scale) in enumerate(zip(self.state, self.scales, strict=False)):
            name = names[i // 2]
            if i % 2 == 0:
                title, amount = name, f"{value:+.3f} m" if i == 0 else f"{math.degrees(value):+.2f}°"
            else:
                title = f"{name}, velocity"
                amount = f"{value:+.3f} m/s" if i == 1 else f"{math.degrees(value):+.1f}°/s"
            shown = i % 2 == 0 or self.velocities
            readings.append((title, amount, f"{value / scale:+.4f}" if shown else None))
        return readings


def picture(view: View) -> Frame:
    """A picture of the moment, ``(HEIGHT, WIDTH, 3)``."""
    canvas = stage(view.title, view.aim, view.message(), _cards(view))
    canvas.text((WIDTH - MARGIN, 88), f"return {view.episode_return:.6g}", 17, palette.FAINT, "rm")
    canvas.text((MARGIN, 525), view.time, 14, palette.FAINT)
    _track(canvas, view)
    _cart(canvas, view)
    return canvas.frame()


def _track(canvas: Canvas, view: View) -> None:
    """Draws rails with a ruler below them, and a buffer at either end."""
    reach = view.track * _METRE
    color = palette.RED if view.off_the_track else palette.INK
    canvas.line((_MIDDLE - reach - 60, _GROUND), (_MIDDLE + reach + 60, _GROUND), palette.LINE, 3)
    canvas.line((_MIDDLE - reach, _GROUND), (_MIDDLE + reach, _GROUND), palette.FAINT, 3)
    for side in (-1, 1):
        x = _MIDDLE + side * reach
        canvas.box((x - 4, _GROUND - 30), (x + 4, _GROUND + 6), color, radius=2)
        canvas.text((x, _GROUND + 20), f"{side * view.track:+g} m", 14, color, "mm")
    for mark in (-2, -1, 0, 1, 2):
        x = _MIDDLE + mark * _METRE
        canvas.line((x, _GROUND), (x, _GROUND + 7), palette.FAINT)
        if abs(mark) < 2:  # the others would be too close to the ends
            canvas.text((x, _GROUND + 20), f"{mark}", 14, palette.FAINT, "mm")


def _cart(canvas: Canvas, view: View) -> None:
    x = _MIDDLE + _within(view.state[0], view.track + 0.2) * _METRE
    top = _GROUND - 2 * _WHEEL - _CART_HEIGHT + 4
    hinges = [(x + shift, top) for shift in _HINGES[len(view.angles) - 1]]
    for hinge, length in zip(hinges, _LENGTHS, strict=False):
        for side in (-1, 1):
            canvas.dashes(hinge, _tip(hinge, side * view.lean, max(length, 0.25) * _METRE * 1.05), palette.LINE)
    for i, (hinge, angle) in enumerate(zip(hinges, view.angles, strict=True)):
        _pole(canvas, hinge, angle, _LENGTHS[i] * _METRE, _WIDTHS[i], palette.RED if view.fallen[i] else _COLORS[i])
    canvas.box((x - _CART_WIDTH / 2, top), (x + _CART_WIDTH / 2, top + _CART_HEIGHT), palette.SAND, palette.INK, 5)
    canvas.line((x, top + _CART_HEIGHT), (x, _GROUND), palette.INK)  # the cart's place is that of its middle
    for hinge in hinges:
        canvas.disc(hinge, 5, palette.INK)
    for side in (-1, 1):
        canvas.disc((x + side * _CART_WIDTH * 0.3, _GROUND - _WHEEL), _WHEEL, palette.INK, palette.PAPER)
    _force(canvas, view, x, top + _CART_HEIGHT / 2 + 1)


def _force(canvas: Canvas, view: View, x: float, y: float) -> None:
    """Draws an arrow that pushes the cart from behind, in proportion to the force."""
    if view.force is None:
        return
    side = 1.0 if view.force > 0 else -1.0
    size = 14.0 + 5.0 * abs(view.force)
    edge = x - side * (_CART_WIDTH / 2 + 6)
    canvas.arrow((edge - side * size / 2, y), (side, 0.0), size, palette.GREEN)
    canvas.text((edge, y - 12 - size * 0.3), f"{view.force:+.2f} N", 14, palette.GREEN, "rm" if side > 0 else "lm")


def _pole(canvas: Canvas, hinge: Point, angle: float, length: float, width: float, color: str) -> None:
    tip = _tip(hinge, angle, length)
    canvas.line(hinge, tip, color, width)
    for end in (hinge, tip):
        canvas.disc(end, width / 2, color)


def _tip(hinge: Point, angle: float, length: float) -> Point:
    angle = _within(angle, math.pi / 2)
    return hinge[0] + length * math.sin(angle), hinge[1] - length * math.cos(angle)


def _within(value: float, bound: float) -> float:
    """The value, or the bound if it lies beyond."""
    return min(max(value, -bound), bound)


def _cards(view: View) -> list[Card]:
    """A card for each number of the state; numbers that the agent does not see are grey."""
    wrong = [view.off_the_track, False, *(flag for down in view.fallen for flag in (down, False))]
    cards = []
    for bad, (title, value, seen) in zip(wrong, view.readings(), strict=True):
        note = "hidden" if seen is None else f"sees {seen}"
        if bad:
            fill, color = palette.ROSE, palette.RED
        else:
            fill, color = (palette.PAPER, palette.FAINT) if seen is None else (palette.WHITE, palette.INK)
        cards.append(Card(title, value, note, fill=fill, color=color))
    return cards


def text(view: View) -> str:
    """A sketch of the moment in a few lines."""
    place = round((_within(view.state[0], view.track) / view.track + 1) / 2 * (_TEXT_CELLS - 1))
    marks = ["-"] * _TEXT_CELLS
    marks[place] = "A"
    leaning = ", ".join(
        f"{name} {_slant(angle, view.lean)} {math.degrees(angle):+.2f}°"
        for name, angle in zip(view.names, view.angles, strict=True)
    )
    seen = " ".join(value for _, _, value in view.readings() if value is not None)
    force = "none" if view.force is None else f"{view.force:+.2f} N"
    return "\n".join(
        [
            f"|{''.join(marks)}|  {view.message()[0]}",
            f" cart {view.state[0]:+.3f} m, {leaning}, force {force}",
            f" sees {seen}{'' if view.velocities else ', no velocities'}",
            f" {view.time}, return {view.episode_return:.6g}",
        ]
    )


def _slant(angle: float, lean: float) -> str:
    """A character that leans as a pole does."""
    if abs(angle) < 0.1 * lean:
        return "|"
    if abs(angle) <= lean:
        return "/" if angle > 0 else "\\"
    return "_"
