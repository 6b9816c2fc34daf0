"""Pictures of the Tiger problem, for people who have never heard of it, and a sketch of it in text."""

from __future__ import annotations

from dpsearch.env_kit.drawing import palette
from dpsearch.env_kit.drawing.canvas import Canvas, Frame, Point
from dpsearch.env_kit.drawing.scene import Icon, Message, agent, stage
from dpsearch.pomdp import cards as tabular_drawing
from dpsearch.pomdp.env import Moment

_SIDES = ("left", "right")
_MIDDLES = (270.0, 690.0)  # centres of the doors
_TOP, _FLOOR, _HALF = 138.0, 352.0, 82.0  # top and bottom of the doors, and half their width
_WINDOW_Y, _WINDOW = 214.0, 50.0  # a round window in each, and its radius
_AGENT: Point = (480.0, 300.0)
_FUR, _DOOR, _FRAME = "#e79a32", "#b07d4b", "#7a5230"


def picture(moment: Moment) -> Frame:
    """A picture of the moment, ``(HEIGHT, WIDTH, 3)``."""
    aim = "One door hides a tiger (-100), the other a treasure (+10). Listen (-1), or open one."
    sees = Icon(44, lambda canvas, center: _growl(canvas, center, _heard(moment), palette.INK, 0.5))
    canvas = stage("Tiger", aim, _message(moment), tabular_drawing.cards(moment, sees, digits=0))
    canvas.line((40, _FLOOR), (920, _FLOOR), palette.LINE, 3)
    for side, x in enumerate(_MIDDLES):
        _door(canvas, moment, side, x)
    agent(canvas, _AGENT, 40)
    heard = _heard(moment)
    if heard is not None:
        means = palette.BLUE if _opened(moment) is None else palette.LINE
        edge = _MIDDLES[heard] + (-1 if heard else 1) * (_HALF + 22)
        _growl(canvas, (edge + (-1 if heard else 1) * 30, _WINDOW_Y), heard, means, 1.3)
    return canvas.frame()


def _heard(moment: Moment) -> int | None:
    """The side on which growling was heard, 0 for left and 1 for right."""
    return next((side for side, name in enumerate(_SIDES) if moment.sees.endswith(name)), None)


def _opened(moment: Moment) -> int | None:
    """The side of the door that was opened just now."""
    if moment.last_action is None or not moment.did.startswith("open"):
        return None
    return int(moment.did.endswith("right"))


def _message(moment: Moment) -> Message:
    late = " Time is up." if moment.step >= moment.max_steps and not moment.terminated else ""
    opened, heard = _opened(moment), _heard(moment)
    if opened is not None:
        door = f"It opened the {_SIDES[opened]} door"
        anew = "" if moment.terminated else " Then the tiger was placed anew."
        if not moment.state_shown or moment.last_state is None:
            return Message(f"{door}.{anew}{late}")
        found, color = ("tiger", palette.RED) if moment.last_state % 2 == opened else ("treasure", palette.GREEN)
        return Message(f"{door}: the {found} was there, {moment.last_reward:+g}.{anew}{late}", color)
    if heard is None:
        return Message("Nothing was heard yet: the tiger may be behind either door.")
    wrong = moment.state_shown and moment.state % 2 != heard
    growling = f"Growling was heard behind the {_SIDES[heard]} door"
    return Message(f"{growling}{': misheard' if wrong else ''}.{late}", palette.BLUE)


def _door(canvas: Canvas, moment: Moment, side: int, x: float) -> None:
    """Draws a door: in its round window what is behind it, and the find if it was opened."""
    opened = _opened(moment) == side
    canvas.box((x - _HALF - 10, _TOP - 10), (x + _HALF + 10, _FLOOR), _FRAME, radius=6)
    if opened and moment.terminated:
        _doorway(canvas, moment, side, x)
    else:
        canvas.box((x - _HALF, _TOP), (x + _HALF, _FLOOR), _DOOR, radius=3)
        canvas.box((x - _HALF + 22, _FLOOR - 66), (x + _HALF - 22, _FLOOR - 18), None, _FRAME, 4)
        knob = x + (1 if side == 0 else -1) * (_HALF - 14)
        canvas.disc((knob, (_TOP + _FLOOR) / 2 + 30), 7, palette.GOLD, _FRAME)
        tiger = moment.state % 2 == side
        glass = palette.mix(palette.NIGHT, _FRAME, 0.3)
        if moment.state_shown:
            glass = palette.ROSE if tiger else palette.MINT
        canvas.disc((x, _WINDOW_Y), _WINDOW + 4, glass, _FRAME)
        _content(canvas, moment, side, (x, _WINDOW_Y), _WINDOW)
    if opened:
        _tag(canvas, moment, (x, _TOP - 12))
    if moment.belief is not None:
        probability = float(moment.belief[side::2].sum())
        text = f"tiger here: {tabular_drawing.percent(probability)}"
        canvas.text((x, _FLOOR + 19), text, 17, palette.BLUE, "mm")
        tabular_drawing.bar(canvas, (x - _HALF, _FLOOR + 34), (2 * _HALF, 12), probability)


def _doorway(canvas: Canvas, moment: Moment, side: int, x: float) -> None:
    """Draws a door that stands open for good, and the room behind it."""
    canvas.box((x - _HALF, _TOP), (x + _HALF, _FLOOR), palette.NIGHT)
    outward = -1 if side == 0 else 1
    hinge, edge = x + outward * _HALF, x + outward * (_HALF + 56)
    leaf = [(hinge, _TOP), (edge, _TOP + 20), (edge, _FLOOR + 18), (hinge, _FLOOR)]
    canvas.polygon(leaf, _DOOR)
    _content(canvas, moment, side, (x, _FLOOR - 84), 64)


def _content(canvas: Canvas, moment: Moment, side: int, center: Point, radius: float) -> None:
    if not moment.state_shown:
        canvas.text(center, "?", round(radius), palette.WHITE, "mm")
    elif moment.state % 2 == side:
        _tiger(canvas, center, radius * 0.8)
    else:
        _treasure(canvas, center, radius * 0.8)


def _tag(canvas: Canvas, moment: Moment, center: Point) -> None:
    """Draws a label at the door that was opened."""
    (x, y), text, color = center, "opened", palette.FAINT
    if moment.state_shown and moment.last_reward is not None:
        text = f"{moment.last_reward:+g}"
        color = palette.GREEN if moment.last_reward > 0 else palette.RED
    canvas.box((x - 46, y - 17), (x + 46, y + 17), color, palette.WHITE, 17)
    canvas.text(center, text, 20, palette.WHITE, "mm")


def _growl(canvas: Canvas, center: Point, side: int | None, color: str, scale: float) -> None:
    """Draws waves of sound that come from the left or the right."""
    if side is None:
        return
    away = 1 if side == 0 else -1
    (x, y), middle = center, 0 if side == 0 else 180
    for radius in (14, 30, 46):
        canvas.arc((x - away * 30 * scale, y), radius * scale, (middle - 40, middle + 40), color, 4 * scale)


def _tiger(canvas: Canvas, center: Point, r: float) -> None:
    """Draws the face of a tiger."""

    def at(x: float, y: float) -> Point:
        return center[0] + r * x, center[1] + r * y

    for s in (-1, 1):
        canvas.disc(at(0.66 * s, -0.66), 0.3 * r, _FUR, palette.INK)
        canvas.disc(at(0.66 * s, -0.66), 0.14 * r, palette.INK)
    canvas.disc(center, r, _FUR, palette.INK)
    canvas.polygon([at(-0.12, -0.97), at(0.12, -0.97), at(0, -0.5)], palette.INK)
    for s in (-1, 1):
        canvas.polygon([at(0.3 * s, -0.93), at(0.5 * s, -0.84), at(0.26 * s, -0.56)], palette.INK)
        for y in (-0.05, 0.32):
            canvas.polygon([at(0.97 * s, y - 0.1), at(0.94 * s, y + 0.12), at(0.6 * s, y + 0.04)], palette.INK)
        canvas.disc(at(0.36 * s, -0.2), 0.18 * r, palette.WHITE)
        canvas.disc(at(0.33 * s, -0.18), 0.09 * r, palette.INK)
        canvas.disc(at(0.21 * s, 0.4), 0.28 * r, palette.WHITE)
        canvas.polygon([at(0.1 * s, 0.62), at(0.28 * s, 0.6), at(0.19 * s, 0.84)], palette.WHITE)
    canvas.polygon([at(-0.17, 0.14), at(0.17, 0.14), at(0, 0.36)], palette.INK)
    canvas.line(at(0, 0.3), at(0, 0.58), palette.INK, 0.06 * r)


def _treasure(canvas: Canvas, center: Point, r: float) -> None:
    """Draws a heap of coins."""
    for x, y in ((-0.62, 0.5), (0, 0.5), (0.62, 0.5), (-0.31, 0), (0.31, 0), (0, -0.5)):
        coin = (center[0] + r * x, center[1] + r * y)
        canvas.disc(coin, 0.34 * r, palette.GOLD, _FRAME)
        canvas.disc(coin, 0.18 * r, None, palette.mix(palette.GOLD, _FRAME, 0.45))


def text(moment: Moment) -> str:
    """A sketch of the moment in a few lines."""
    names = ("?", "?")
    if moment.state_shown:
        names = ("tiger", "treasure") if moment.state % 2 == 0 else ("treasure", "tiger")
    doors = " ".join(f"[{name:^10}]" for name in names)
    lines = [f" {doors}  {_message(moment).text}", f" {tabular_drawing.status(moment, digits=0)}"]
    if moment.belief is not None:
        left, right = moment.belief[0::2].sum(), moment.belief[1::2].sum()
        lines.append(f" belief: tiger left {left:.1%}, right {right:.1%}")
    return "\n".join(lines)
