"""Pictures of shuttle docking, for people who have never heard of it, and a sketch of it in text."""

from __future__ import annotations

from dpsearch.env_kit.drawing import palette
from dpsearch.env_kit.drawing.canvas import Canvas, Frame, Point
from dpsearch.env_kit.drawing.scene import Icon, Message, stage
from dpsearch.pomdp import cards as tabular_drawing
from dpsearch.pomdp.env import Moment

_AT_LRV, _SPACE, _AT_MRV = 1, 2, 3  # places from left to right, between the docks 0 and 4
_TO_LRV, _TO_MRV = -1, 1  # direction of the nose in each state; LRV is drawn at the left
_POSES = (  # places of the eight states
    (0, _TO_MRV),
    (_AT_MRV, _TO_MRV),
    (_SPACE, _TO_MRV),
    (_AT_LRV, _TO_MRV),
    (_AT_MRV, _TO_LRV),
    (_SPACE, _TO_LRV),
    (_AT_LRV, _TO_LRV),
    (4, _TO_LRV),
)
_BY_PLACE = (0, 6, 3, 5, 2, 4, 1, 7)  # the states from left to right

_LEFT, _RIGHT, _TOP, _BOTTOM = 40.0, 920.0, 112.0, 408.0  # the part of the sky that is drawn
_STATIONS = (116.0, 844.0)
_PLACES = (222.0, 334.0, 480.0, 626.0, 738.0)
_ROW, _ROW_ABOVE_CHART = 246.0, 204.0  # height of stations and shuttle
_LENGTH = 92.0
_SKY_TEXT, _LAMP = "#b6c4dd", "#3ddc84"


def picture(moment: Moment) -> Frame:
    """A picture of the moment, ``(HEIGHT, WIDTH, 3)``."""
    aim = "Carry cargo to and fro: dock, tail first, at the station that was not visited last (+10)."
    sees = Icon(44, lambda canvas, center: _view(canvas, center, 22, moment))
    canvas = stage("Shuttle docking", aim, _message(moment), tabular_drawing.cards(moment, sees, digits=0))
    canvas.box((_LEFT, _TOP), (_RIGHT, _BOTTOM), palette.NIGHT, radius=12)
    for k in range(70):  # stars, scattered by the golden ratio
        x, y = k * 0.618034 % 1, k * 0.754878 % 1
        at = (_LEFT + 8 + (_RIGHT - _LEFT - 16) * x, _TOP + 8 + (_BOTTOM - _TOP - 16) * y)
        canvas.disc(at, 0.8 + k % 3 * 0.4, palette.mix(palette.NIGHT, palette.WHITE, 0.35 + 0.1 * (k % 4)))
    row = _ROW if moment.belief is None else _ROW_ABOVE_CHART
    for x, title, prize, accepting in (
        (_STATIONS[0], "least recently visited", "LRV, accepts cargo: +10", True),
        (_STATIONS[1], "most recently visited", "MRV, accepts none", False),
    ):
        _station(canvas, (x, row), 1.0, accepting)
        _label(canvas, (x, row + 73), title, 14, palette.WHITE)
        _label(canvas, (x, row + 92), prize, 12, _LAMP if accepting else _SKY_TEXT)
    if moment.state_shown:
        _shuttle_here(canvas, moment, row)
    else:
        _view(canvas, (480, row), 96, moment)
        _label(canvas, (480, row + 120), "what its window shows", 15, _SKY_TEXT)
    if moment.belief is not None:
        _chart(canvas, moment)
    return canvas.frame()


def _label(canvas: Canvas, center: Point, text: str, size: int, color: str) -> None:
    """Writes text on a patch without stars."""
    (x, y), half = center, canvas.text_width(text, size) / 2
    canvas.box((x - half, y - size / 2), (x + half, y + size / 2), palette.NIGHT)
    canvas.text(center, text, size, color, "mm")


def _message(moment: Moment) -> Message:
    late = " Time is up." if moment.step >= moment.max_steps else ""
    if moment.last_action is None:
        return Message("The start: docked at the station that was visited last.")
    story = _story(moment) if moment.state_shown else _sight(moment)
    return Message(story.text + late, story.color)


def _sight(moment: Moment) -> Message:
    """Sentence about the observation."""
    sights = {
        "sees LRV": "Ahead is the least recently visited station, which accepts cargo.",
        "sees MRV": "Ahead is the station that was visited last.",
        "docked at MRV": "It is docked at the station that was visited last.",
        "docked at LRV": "It is docked at the least recently visited station and has delivered its cargo.",
    }
    color = palette.GREEN if moment.sees == "docked at LRV" else palette.INK
    return Message(sights.get(moment.sees, "It sees nothing but stars."), color)


def _story(moment: Moment) -> Message:
    """Sentence about the effect of the last action."""
    assert moment.last_state is not None
    assert moment.last_reward is not None
    (before, nose), (place, now) = _POSES[moment.last_state], _POSES[moment.state]
    docked, turned = before in (0, 4), nose != now
    reward = f"{moment.last_reward:+g}"
    swap = " Its station is now the one visited last." if before == 0 else ""
    if moment.last_reward < 0:
        return Message(f"It bumped into the station ahead: {reward}.", palette.RED)
    if moment.last_reward > 0:
        return Message(f"It docked at the least recently visited station: {reward}.", palette.GREEN)
    if moment.did == "turn around":
        return Message(("It left the dock and turned to face the station." if docked else "It turned around.") + swap)
    if moment.did == "go forward":
        if docked:
            return Message(f"It left the dock.{swap}")
        return Message("It flew out into space." if place == _SPACE else "It approached the station ahead.")
    if docked:
        return Message(f"It backed up in the dock, and stays there.{swap}")
    if place == 4:
        return Message("It docked where it had been last: nobody wants its cargo there.")
    if place == before:
        away = before != _SPACE and (nose == _TO_MRV) == (before == _AT_LRV)
        effort = "It tried to dock" if away else "It tried to back up"
        return Message(f"{effort} but {'was turned around' if turned else 'stayed where it was'}.", palette.RED)
    where = "out into space" if place == _SPACE else "to the station behind it"
    return Message(f"It backed {where}{' but was turned around' if turned else ''}.")


def _shuttle_here(canvas: Canvas, moment: Moment, row: float) -> None:
    place, nose = _POSES[moment.state]
    x = _PLACES[place]
    thrust = 0
    if moment.last_action is not None and moment.did != "turn around":
        thrust = 1 if moment.did == "go forward" else -1
    _shuttle(canvas, (x, row), _LENGTH, nose, palette.ORANGE, thrust)
    if moment.last_reward is not None and moment.last_reward < 0:
        tip = x + nose * _LENGTH * 0.55
        canvas.polygon(_star((tip, row), 26, 9), palette.RED)
        canvas.polygon(_star((tip, row), 15, 9), palette.GOLD)
        canvas.text((tip, row - 42), f"{moment.last_reward:+g}", 20, palette.ROSE, "mm")
    elif moment.last_reward is not None and moment.last_reward > 0:
        canvas.text((x, row - 42), f"{moment.last_reward:+g}", 24, _LAMP, "mm")


def _star(center: Point, radius: float, points: int) -> list[Point]:
    corners = []
    for k in range(2 * points):
        turn = complex(0, 1) ** (2 * k / points) * radius * (1 if k % 2 else 0.5)
        corners.append((center[0] + turn.real, center[1] + turn.imag))
    return corners


def _shuttle(canvas: Canvas, center: Point, length: float, nose: int, color: str, thrust: int = 0) -> None:
    """Draws the shuttle. ``nose`` is -1 if it points to the left; ``thrust`` is 1 if it flies forward, -1 backward."""

    def at(along: float, across: float) -> Point:
        return center[0] + length * along * nose, center[1] + length * across

    dark = palette.mix(color, palette.NIGHT, 0.35)
    if thrust > 0:
        canvas.polygon([at(-0.44, -0.11), at(-0.82, 0), at(-0.44, 0.11)], palette.GOLD)
        canvas.polygon([at(-0.44, -0.06), at(-0.64, 0), at(-0.44, 0.06)], palette.WHITE)
    for side in (-1, 1):
        canvas.polygon([at(-0.4, 0.16 * side), at(-0.5, 0.34 * side), at(0.05, 0.18 * side)], dark)
        if thrust < 0:
            canvas.polygon([at(0.28, 0.17 * side), at(0.52, 0.3 * side), at(0.36, 0.12 * side)], palette.GOLD)
    canvas.polygon([at(-0.5, -0.1), at(-0.4, -0.1), at(-0.4, 0.1), at(-0.5, 0.1)], palette.LINE)
    hull = [(-0.42, 0.18), (0.16, 0.18), (0.32, 0.14), (0.43, 0.08), (0.5, 0.0)]
    canvas.polygon([at(x, y) for x, y in hull] + [at(x, -y) for x, y in reversed(hull)], color)
    canvas.disc(at(0.2, 0), 0.09 * length, palette.SKY, dark)
    canvas.polygon([at(-0.3, -0.09), at(-0.02, -0.09), at(-0.02, 0.09), at(-0.3, 0.09)], dark)


def _station(canvas: Canvas, center: Point, scale: float, accepting: bool) -> None:
    """Draws a station: a ring with solar panels, and a lamp that is green where cargo is accepted."""
    x, y = center
    for side in (-1, 1):
        canvas.line((x, y), (x, y + side * 54 * scale), palette.FAINT, 5 * scale)
        for k in (-1, 0, 1):
            left = x + (k * 20 - 9) * scale
            top = y + (side * 45 - 12) * scale
            canvas.box((left, top), (left + 18 * scale, top + 24 * scale), palette.BLUE, palette.SKY)
    canvas.box((x - 46 * scale, y - 9 * scale), (x + 46 * scale, y + 9 * scale), palette.LINE, radius=4 * scale)
    canvas.disc(center, 30 * scale, palette.LINE, palette.FAINT)
    canvas.disc(center, 19 * scale, palette.NIGHT)
    canvas.disc(center, 11 * scale, _LAMP if accepting else palette.RED)


def _view(canvas: Canvas, center: Point, radius: float, moment: Moment) -> None:
    """Draws the observation through a round window."""
    canvas.disc(center, radius, palette.NIGHT, palette.FAINT)
    if "LRV" in moment.sees or "MRV" in moment.sees:
        docked = moment.sees.startswith("docked")
        _station(canvas, center, radius / (68 if docked else 90), "LRV" in moment.sees)
        return
    for x, y in ((-0.5, -0.3), (0.1, -0.6), (0.5, 0.0), (-0.2, 0.3), (0.3, 0.55), (-0.6, 0.25), (0.0, -0.1)):
        canvas.disc((center[0] + radius * x, center[1] + radius * y), 0.4 + radius / 50, palette.WHITE)


def _chart(canvas: Canvas, moment: Moment) -> None:
    """Draws the belief: the probability of each state, from left to right, below a small shuttle in that state."""
    assert moment.belief is not None
    base, full = 366.0, 46.0
    _label(canvas, (116, base - 8), "how probable", 14, palette.SKY)
    _label(canvas, (116, base + 10), "each position is", 14, palette.SKY)
    for k, state in enumerate(_BY_PLACE):
        x, (place, nose) = 482 + (k - 3.5) * 76, _POSES[state]
        probability = float(moment.belief[state])
        height = full * probability
        canvas.box((x - 15, base - full), (x + 15, base), palette.mix(palette.NIGHT, palette.WHITE, 0.12), radius=3)
        if probability > 0:
            canvas.box((x - 15, base - max(height, 2)), (x + 15, base), palette.SKY, radius=min(3, height / 2))
        label = _SKY_TEXT if probability == 0 else palette.WHITE
        _label(canvas, (x, base - full - 12), tabular_drawing.percent(probability), 14, label)
        color = palette.mix(palette.NIGHT, palette.ORANGE, 0.25 + 0.75 * probability)
        _shuttle(canvas, (x, base + 21), 30, nose, color)
        if place != _SPACE:  # a piece of the station beside it
            side = -1 if place < _SPACE else 1
            gap = 18 if place in (0, 4) else 24
            canvas.line((x + side * gap, base + 10), (x + side * gap, base + 32), palette.LINE, 4)


def text(moment: Moment) -> str:
    """A sketch of the moment in a few lines."""
    marks = ["?"] * 5
    if moment.state_shown:
        place, nose = _POSES[moment.state]
        marks = ["."] * 5
        marks[place] = ">" if nose == _TO_MRV else "<"
    lines = [f" LRV [{' '.join(marks)}] MRV  {_message(moment).text}", f" {tabular_drawing.status(moment, digits=0)}"]
    if moment.belief is not None:
        lines.append(f" belief: {tabular_drawing.likely(moment.pomdp.state_names, moment.belief)}")
    return "\n".join(lines)
