"""Pictures of the T-maze, for people who have never heard of it, and a sketch of it in text."""

from __future__ import annotations

from dataclasses import dataclass

from dpsearch.envs.drawing import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    LINE,
    MINT,
    ORANGE,
    RED,
    ROSE,
    SAND,
    WHITE,
    Canvas,
    Frame,
    Point,
)

WIDTH, HEIGHT = 960, 540
_SLOTS = 13  # cells that fit side by side, a gap counting as one
_EDGE, _AROUND = 2, 3  # cells shown at either end of a long corridor, and on either side of the agent
_MIDDLE, _MAZE_WIDTH, _CELL = 262, 840, 76.0  # height of the corridor, most it may be wide, largest cell

_UP, _DOWN = (0.0, -1.0), (0.0, 1.0)
_DIRECTIONS: dict[str, Point] = {"north": _UP, "east": (1.0, 0.0), "south": _DOWN, "west": (-1.0, 0.0)}


@dataclass(frozen=True)
class View:
    """All that is drawn.

    Attributes:
        corridor_length: Position of the junction.
        position: Where the agent is, or was when it left through an arm of the junction.
        sign: "up" or "down".
        arm: The arm that it has left through, "north" or "south"; None while it is in the corridor.
        sees: Name of what it sees.
        inputs: The numbers that it receives for that.
        last_action: Name of the action before, or None.
        step: Steps so far.
        max_steps: Steps at which the episode is cut off.
        episode_return: Sum of rewards so far.
    """

    corridor_length: int
    position: int
    sign: str
    arm: str | None
    sees: str
    inputs: tuple[float, ...]
    last_action: str | None
    step: int
    max_steps: int
    episode_return: float

    @property
    def goal(self) -> str:
        """The arm that the sign points to."""
        return "north" if self.sign == "up" else "south"

    @property
    def sign_is_shown(self) -> bool:
        """Whether the agent sees the sign right now."""
        return self.sees.startswith("sign")

    def message(self) -> tuple[str, str]:
        """What goes on, in a sentence, and its color."""
        if self.arm is not None:
            outcome, color = ("right, +4", GREEN) if self.arm == self.goal else ("wrong, -0.1", RED)
            return f"The sign pointed {self.sign}, the agent turned {self.arm}: {outcome}.", color
        if self.step >= self.max_steps:
            return "Time is up.", RED
        if self.sign_is_shown:
            return f"The road sign points {self.sign}. It is shown only now.", BLUE
        if self.position == self.corridor_length:
            return "The junction. Which way did the sign point?", INK
        return "The sign is out of sight, and must be remembered until the junction.", INK


def visible_cells(corridor_length: int, position: int) -> list[int | None]:
    """The corridor's cells from left to right as they are drawn, None for a gap that leaves cells out.

    Always the same number for one length, so that pictures of an episode do not jump.
    """
    last = corridor_length
    if last < _SLOTS:
        return list(range(last + 1))
    head, tail = list(range(_EDGE)), list(range(last - _EDGE + 1, last + 1))
    near = 2 * _EDGE + _AROUND - 1  # so near an end, one gap is enough
    long = _SLOTS - 1 - _EDGE
    if position <= near:
        return [*range(long), None, *tail]
    if position >= last - near:
        return [*head, None, *range(last - long + 1, last + 1)]
    return [*head, None, *range(position - _AROUND, position + _AROUND + 1), None, *tail]


def picture(view: View) -> Frame:
    """A picture of the moment, ``(HEIGHT, WIDTH, 3)``."""
    canvas = Canvas(WIDTH, HEIGHT)
    message, color = view.message()
    canvas.text((40, 42), "T-maze", 30)
    canvas.text((158, 45), "Remember the road sign, walk to the junction, turn the way it pointed.", 17, FAINT)
    canvas.text((40, 88), message, 21, color)
    _maze(canvas, view)
    _panel(canvas, view)
    return canvas.frame()


def _maze(canvas: Canvas, view: View) -> None:
    cells = visible_cells(view.corridor_length, view.position)
    size = min(_MAZE_WIDTH / len(cells), _CELL)
    left = (WIDTH - size * len(cells)) / 2
    centers = [(left + (i + 0.5) * size, float(_MIDDLE)) for i in range(len(cells))]
    for cell, (x, y) in zip(cells, centers, strict=True):
        if cell is None:
            for dot in (-1, 0, 1):
                canvas.disc((x + dot * size / 4, y), size / 16, FAINT)
            continue
        _cell(canvas, (x, y), size, SAND)
        junction = cell == view.corridor_length
        label = (x + size * 0.6, y) if junction else (x, y + size * 0.66)
        canvas.text(label, str(cell), 13, FAINT, "lm" if junction else "mm")
    x, y = centers[-1]
    arms = {"north": (x, y - size), "south": (x, y + size)}
    for arm, center in arms.items():
        right = arm == view.goal
        _cell(canvas, center, size, SAND if arm != view.arm else MINT if right else ROSE)
        canvas.text(center, "+4" if right else "-0.1", round(size / 3.4), GREEN if right else RED, "mm")
    _sign(canvas, view, centers[0], size)
    at = centers[cells.index(view.position)] if view.arm is None else arms[view.arm]
    _agent(canvas, at, size * 0.3)


def _cell(canvas: Canvas, center: Point, size: float, fill: str) -> None:
    (x, y), half = center, size / 2
    canvas.box((x - half, y - half), (x + half, y + half), fill, LINE)


def _agent(canvas: Canvas, center: Point, radius: float) -> None:
    canvas.disc(center, radius, ORANGE, WHITE)
    for side in (-1, 1):
        canvas.disc((center[0] + side * radius * 0.36, center[1] - radius * 0.15), radius * 0.16, INK)


def _sign(canvas: Canvas, view: View, start: Point, size: float) -> None:
    """A board on a post beside the start; grey once the agent can no longer see it."""
    half = size * 0.36
    x, y = start[0], start[1] - size * 1.1
    color = BLUE if view.sign_is_shown else LINE
    canvas.line((x, y), (x, start[1] - size / 2), color, 5)
    canvas.box((x - half, y - half), (x + half, y + half), color, radius=6)
    canvas.arrow((x, y), _UP if view.sign == "up" else _DOWN, half * 1.5, WHITE)


def _panel(canvas: Canvas, view: View) -> None:
    """Four cards below the maze."""
    top, height, gap = 420, 88, 16
    width = (WIDTH - 80 - 3 * gap) / 4
    cards = {
        "The agent sees": view.sees,
        "Its last action": view.last_action or "none yet",
        "Step": f"{view.step} of {view.max_steps}",
        "Return": f"{view.episode_return:.1f}",
    }
    for i, (title, value) in enumerate(cards.items()):
        x = 40 + i * (width + gap)
        canvas.box((x, top), (x + width, top + height), WHITE, LINE, 8)
        canvas.text((x + 16, top + 22), title, 14, FAINT)
        canvas.text((x + 16, top + 58), value, 20)
    for k, bit in enumerate(reversed(view.inputs)):
        x, y = 40 + width - 24 - 17 * k, top + 58
        canvas.box((x - 7, y - 7), (x + 7, y + 7), INK if bit else WHITE, INK, 2)
    if view.last_action is not None:
        canvas.arrow((40 + 2 * width + gap - 34, top + 58), _DIRECTIONS[view.last_action], 34, INK)


def text(view: View) -> str:
    """A sketch of the moment in four lines."""
    cells = visible_cells(view.corridor_length, view.position)
    marks = ["..." if cell is None else "." for cell in cells]
    marks[0] = "S"
    if view.arm is None:
        marks[cells.index(view.position)] = "A"
    corridor = " ".join(marks)
    margin = " " * (len(corridor) + 1)
    north, south = (
        ("A " if arm == view.arm else "") + ("+4" if arm == view.goal else "-0.1") for arm in ("north", "south")
    )
    inputs = " ".join(f"{value:g}" for value in view.inputs)
    return "\n".join(
        [
            f"{margin}{north}",
            f" {corridor}|  {view.message()[0]}",
            f"{margin}{south}",
            f" sign {view.sign}, sees {view.sees} ({inputs}), last action {view.last_action or 'none'}, "
            f"step {view.step} of {view.max_steps}, return {view.episode_return:.1f}",
        ]
    )
