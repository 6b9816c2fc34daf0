"""Pictures of mazes on a grid, for people who have never heard of them, and a sketch of them in text."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpsearch.env_kit.drawing import palette
from dpsearch.env_kit.drawing.canvas import Canvas, Frame, Point
from dpsearch.env_kit.drawing.scene import MARGIN, WIDTH, Icon, Message, agent, arrow, stage
from dpsearch.pomdp import cards as tabular_drawing
from dpsearch.pomdp.env import Moment
from dpsearch.pomdp.grid import DIRECTIONS, EAST, Grid

_TOP, _BOTTOM, _LARGEST_CELL = 114.0, 406.0, 92.0
_COMPASS: tuple[Point, ...] = ((0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0))  # as in DIRECTIONS
_SIDES = ("ahead", "on the right", "behind", "on the left")
_ROCK = "#ddd8cc"
_FILLS = {"+": palette.MINT, "G": palette.MINT, "T": palette.MINT, "-": palette.ROSE}  # fill of marked cells
_TURNS = {"turn left": 3, "turn right": 1, "turn about": 2, "do nothing": 0}  # quarter turns to the right
_TURNED = ("did not turn", "turned right", "turned about", "turned left")

_Felt = tuple[bool | None, ...]
"""Whether a wall is felt to the north, east, south and west, or on four sides; None where the agent cannot feel."""


@dataclass(frozen=True)
class Look:
    """The words of a maze's drawing.

    Attributes:
        title: Name of the maze.
        aim: The aim in words.
        rules: The rules in a few sentences.
        goal: Name of the goal.
        felt: Walls that each symbol tells of, unless its inputs are one for each side. A symbol beyond these tells of
            none.
        minus: Label of the cell ``-``.
    """

    title: str
    aim: str
    rules: tuple[str, ...]
    goal: str
    felt: tuple[_Felt, ...] | None = None
    minus: str = "-1"

    def label(self, mark: str) -> str | None:
        """Label of a cell with this mark; None if it has none."""
        return {"+": "+1", "-": self.minus, "G": "+1"}.get(mark)


CHEESE_MAZE = Look(
    title="Cheese maze",
    aim="Find the cheese: +1. What the agent sees are the walls around it.",
    rules=(
        "The agent sees the four walls of its cell, and nothing else: many cells look the same.",
        "It goes where it wants to, unless there is a wall.",
        "To know where it is, it must remember where it came from.",
    ),
    goal="the cheese",
)
MAZE4X3 = Look(
    title="4x3 maze",
    aim="Reach +1 and keep away from -1. Any other step costs 0.04.",
    rules=(
        "The agent sees whether there is a wall on the left and on the right, and nothing else.",
        "8 times out of 10 it goes where it wants to. It slips to one side once, and once to the other.",
        "Where there is a wall it stays.",
    ),
    goal="the end",
    felt=((None, False, None, True), (None, True, None, False), (None, False, None, False), (None, True, None, True)),
)
MAZE89 = Look(
    title="89-state maze",
    aim="Find the goal: +1. Neither legs nor eyes can be relied upon.",
    rules=(
        "The agent sees where there are walls around it. Of 10 walls it misses one, and of 20 openings it takes one "
        "for a wall.",
        "Of 10 tries to go ahead 8 succeed, of 10 turns 7, and 6 if they are half turns. Else it comes out on a side, "
        "stays, or faces another way.",
    ),
    goal="the goal",
)


@dataclass(frozen=True)
class _View:
    """A moment of a maze, for its drawing.

    Attributes:
        moment: The moment that is drawn.
        grid: The maze.
        look: The words of the drawing.
    """

    moment: Moment
    grid: Grid
    look: Look

    @property
    def headed(self) -> bool:
        """Whether the agent has a heading."""
        return self.moment.pomdp.n_states > len(self.grid.cells)

    def pose(self, state: int) -> tuple[int, int]:
        """Cell and heading, 0 for north if there are no headings."""
        if not self.headed:
            return state, 0
        cell, heading = divmod(state, 4)
        return cell, EAST if self.moment.pomdp.terminal[state] else heading  # the goal has one way in, and no heading

    @property
    def felt(self) -> _Felt:
        """Walls that the agent feels, the one to the north or ahead first."""
        if self.look.felt is None:
            return tuple(value > 0 for value in self.moment.inputs)
        symbol = self.moment.symbol
        return self.look.felt[symbol] if symbol < len(self.look.felt) else (None,) * 4

    @property
    def wrong(self) -> tuple[bool, ...]:
        """Sides on which the agent feels wrongly, as far as the spectator may know."""
        if not self.moment.state_shown:
            return (False,) * 4
        cell, heading = self.pose(self.moment.state)
        walls = np.roll(self.grid.walls[cell], -heading)
        return tuple(felt is not None and felt != wall for felt, wall in zip(self.felt, walls, strict=True))

    @property
    def wanted(self) -> int | None:
        """The direction in which the agent wanted to go."""
        if self.moment.did in DIRECTIONS:
            return DIRECTIONS.index(self.moment.did)
        if self.moment.did != "forward" or self.moment.last_state is None:
            return None
        return self.pose(self.moment.last_state)[1]

    @property
    def went(self) -> int | None:
        """The direction in which it went."""
        if self.moment.last_state is None:
            return None
        before, now = self.pose(self.moment.last_state)[0], self.pose(self.moment.state)[0]
        return None if before == now else self.grid.neighbours[before].tolist().index(now)

    def cell_beliefs(self) -> NDArray[np.float64]:
        """Probability of each cell and heading, ``(C, 4)``, or ``(C, 1)`` if there are no headings."""
        assert self.moment.belief is not None
        beliefs = np.zeros((len(self.grid.cells), 4 if self.headed else 1))
        beliefs.flat[: len(self.moment.belief)] = self.moment.belief
        if self.headed:
            beliefs[-1] = np.roll(beliefs[-1], EAST)  # the goal's only heading, as above
        return beliefs

    def message(self) -> Message:
        """Sentence about the moment."""
        moment = self.moment
        if moment.terminated and self.mark == "-":
            return Message(f"It came to {self.look.minus}, and that is the end.", palette.RED)
        if moment.terminated:
            return Message(f"It has reached {self.look.goal}: +1.", palette.GREEN)
        if moment.step >= moment.max_steps:
            return Message("Time is up.", palette.RED)
        if moment.last_action is None:
            return Message("The start. Where it is, the agent must find out.")
        if not moment.state_shown:
            return Message(f"It wanted to {self.wish}. Now it sees {tabular_drawing.seen(moment)}.")
        return self._story()

    @property
    def mark(self) -> str:
        """Mark of the agent's cell in the drawing of the maze."""
        return self.grid.marks[self.pose(self.moment.state)[0]]

    @property
    def wish(self) -> str:
        """Words for the last action that the agent wanted."""
        did = self.moment.did
        return f"go {did}" if did in DIRECTIONS else "go ahead" if did == "forward" else did

    def _story(self) -> Message:
        """Sentence about the effect of the last action."""
        moment, wanted, went = self.moment, self.wanted, self.went
        assert moment.last_state is not None
        before, now = self.pose(moment.last_state), self.pose(moment.state)
        if wanted is None:
            turned = (now[1] - before[1]) % 4
            if turned == _TURNS[moment.did]:
                return Message(f"It {_TURNED[turned]}." if turned else "It did nothing.")
            return Message(f"It wanted to {self.wish} but {_TURNED[turned]}.", palette.RED)
        cost = f": {moment.last_reward:+g}" if moment.last_reward else ""
        where = f" into {self.look.minus}" if self.mark == "-" else ""
        if went == wanted:
            way = moment.did if moment.did in DIRECTIONS else "ahead"
            return Message(f"It went {way}{where}{cost}.", palette.RED if where else palette.INK)
        if went is None:
            wall = self.grid.walls[before[0], wanted]
            how = "there is a wall" if wall else "it stayed where it was"
            return Message(f"It wanted to {self.wish}, but {how}{cost}.", palette.RED)
        if not self.headed:
            return Message(f"It wanted to {self.wish} but slipped {DIRECTIONS[went]}{where}{cost}.", palette.RED)
        side = (went - before[1]) % 4
        how = f"came out {_SIDES[side]}" if side != 2 else "slid backwards"
        about = " and turned about" if side == 2 and now[1] != before[1] else ""
        return Message(f"It wanted to {self.wish} but {how}{about}.", palette.RED)


def picture(moment: Moment, grid: Grid, look: Look) -> Frame:
    """A picture of the moment, ``(HEIGHT, WIDTH, 3)``."""
    view = _View(moment, grid, look)
    did = arrow(_COMPASS[DIRECTIONS.index(moment.did)]) if moment.did in DIRECTIONS else None
    cards = tabular_drawing.cards(moment, Icon(52, lambda canvas, center: _feel(canvas, center, view)), did)
    seen = tabular_drawing.seen(moment)
    if seen.startswith("walls "):  # the list is long, so part of it goes into the title
        cards[0] = replace(cards[0], title="The agent sees walls", value=seen.removeprefix("walls "))
    canvas = stage(look.title, look.aim, view.message(), cards)
    rows, columns = (1 + max(place) for place in zip(*grid.cells, strict=True))
    size = min(_LARGEST_CELL, (_BOTTOM - _TOP) / rows)
    corner = (MARGIN, (_TOP + _BOTTOM - rows * size) / 2)
    centers = [(corner[0] + (column + 0.5) * size, corner[1] + (row + 0.5) * size) for row, column in grid.cells]
    canvas.box(corner, (corner[0] + columns * size, corner[1] + rows * size), _ROCK)
    _cells(canvas, view, centers, size)
    _walls(canvas, view, centers, size)
    if moment.state_shown:
        _agent(canvas, view, centers, size)
    _notes(canvas, view, corner[0] + columns * size + 44)
    return canvas.frame()


def _cells(canvas: Canvas, view: _View, centers: list[Point], size: float) -> None:
    """Draws the cells, darker where the agent probably is."""
    half = size / 2
    here = view.pose(view.moment.state)[0] if view.moment.state_shown else None
    beliefs = None if view.moment.belief is None else view.cell_beliefs()
    for cell, (mark, (x, y)) in enumerate(zip(view.grid.marks, centers, strict=True)):
        fill = _FILLS.get(mark, palette.SAND if beliefs is None else palette.WHITE)
        probability = 0.0 if beliefs is None else float(beliefs[cell].sum())
        shade = 0.85 * math.sqrt(probability)
        canvas.box((x - half, y - half), (x + half, y + half), palette.mix(fill, palette.BLUE, shade), palette.LINE)
        if cell != here:
            _mark(canvas, mark, view.look.label(mark), (x, y), size)
        if beliefs is not None and probability >= 0.005:
            _probability(canvas, (x, y), size, beliefs[cell], palette.WHITE if shade > 0.45 else palette.INK)


def _mark(canvas: Canvas, mark: str, label: str | None, center: Point, size: float) -> None:
    """Draws the mark of a cell."""
    if mark == "T":
        _cheese(canvas, center, size * 0.3)
    elif label is not None:
        canvas.text(center, label, round(size / 3), palette.RED if mark == "-" else palette.GREEN, "mm")


def _probability(canvas: Canvas, center: Point, size: float, belief: NDArray[np.float64], color: str) -> None:
    """Writes the probability of a cell, and at its edges the probabilities of the headings."""
    (x, y), total = center, float(belief.sum())
    below = 0.25 if len(belief) == 1 else 0.2
    canvas.text((x, y + size * below), tabular_drawing.percent(total), max(13, round(size / 5)), color, "mm")
    if len(belief) == 1:
        return
    for (dx, dy), probability in zip(_COMPASS, belief, strict=True):
        if probability >= 0.1 * total:
            tip, base, half = 0.46 * size, 0.36 * size, 0.04 * size + 0.08 * size * probability / total
            canvas.polygon(
                [
                    (x + tip * dx, y + tip * dy),
                    (x + base * dx - half * dy, y + base * dy + half * dx),
                    (x + base * dx + half * dy, y + base * dy - half * dx),
                ],
                color,
            )


def _walls(canvas: Canvas, view: _View, centers: list[Point], size: float) -> None:
    half = size / 2
    for walls, (x, y) in zip(view.grid.walls, centers, strict=True):
        for (dx, dy), wall in zip(_COMPASS, walls, strict=True):
            if wall:
                middle, reach = (x + half * dx, y + half * dy), half + 2
                start = (middle[0] - reach * dy, middle[1] - reach * dx)
                canvas.line(start, (middle[0] + reach * dy, middle[1] + reach * dx), palette.INK, 4)


def _agent(canvas: Canvas, view: _View, centers: list[Point], size: float) -> None:
    """Draws the agent, its last place, and an arrow the way it wanted to go, if it went another."""
    moment, wanted = view.moment, view.wanted
    cell, heading = view.pose(moment.state)
    crowded = moment.belief is not None
    radius, lift = (0.2, 0.12) if crowded else (0.28, 0.0)
    if moment.last_state is not None:
        x, y = centers[view.pose(moment.last_state)[0]]
        if view.went is not None:
            canvas.disc((x, y - lift * size), radius * size * 0.5, palette.mix(palette.ORANGE, palette.WHITE, 0.6))
        if wanted is not None and view.went != wanted:
            dx, dy = _COMPASS[wanted]
            length = 0.22 if crowded else 0.34
            offset = size * (0.53 - length / 2)
            canvas.arrow((x + offset * dx, y + offset * dy), (dx, dy), length * size, palette.RED)
    x, y = centers[cell]
    agent(canvas, (x, y - lift * size), radius * size, _COMPASS[heading] if view.headed else None)


def _cheese(canvas: Canvas, center: Point, r: float) -> None:
    """Draws a wedge of cheese."""

    def at(x: float, y: float) -> Point:
        return center[0] + r * x, center[1] + r * y

    dark = palette.mix(palette.GOLD, palette.ORANGE, 0.7)
    canvas.polygon(
        [at(-1, 0.05), at(0.55, -0.75), at(1, -0.15), at(1, 0.05)], palette.mix(palette.GOLD, palette.WHITE, 0.4)
    )
    canvas.polygon([at(-1, 0.05), at(1, 0.05), at(1, 0.75), at(-1, 0.75)], palette.GOLD)
    for x, y, radius in ((-0.55, 0.4, 0.17), (0.1, 0.52, 0.13), (0.55, 0.3, 0.2), (-0.15, 0.22, 0.09)):
        canvas.disc(at(x, y), r * radius, dark)


def _feel(canvas: Canvas, center: Point, view: _View) -> None:
    """Draws the walls that the agent feels around it; red ones are wrong."""
    x, y = center[0], center[1] - 12
    label = view.look.label({"at +": "+", "at -": "-"}.get(view.moment.sees, ""))
    if label is not None:
        good = label == "+1"
        fill, color = (palette.MINT, palette.GREEN) if good else (palette.ROSE, palette.RED)
        canvas.box((x - 20, y - 20), (x + 20, y + 20), fill, palette.LINE, 4)
        canvas.text((x, y), label, 18, color, "mm")
        return
    for (dx, dy), felt, wrong in zip(_COMPASS, view.felt, view.wrong, strict=True):
        if felt is None:
            continue
        middle = (x + 24 * dx, y + 24 * dy)
        start, end = (middle[0] - 17 * dy, middle[1] - 17 * dx), (middle[0] + 17 * dy, middle[1] + 17 * dx)
        if felt:
            canvas.line(start, end, palette.RED if wrong else palette.INK, 6)
        elif wrong:
            canvas.dashes(start, end, palette.RED, 4, 4)
        else:
            canvas.line(start, end, palette.LINE, 2)
    agent(canvas, (x, y), 12, _COMPASS[0] if view.headed else None)


def _notes(canvas: Canvas, view: _View, x: float) -> None:
    """Writes the rules and the meaning of the colors beside the maze."""
    width, y = WIDTH - MARGIN - x, 122.0
    for rule in view.look.rules:
        canvas.disc((x + 4, y + 12), 3, palette.FAINT)
        y += canvas.paragraph((x + 18, y), rule, width - 18) + 8
    for side, (felt, wrong) in enumerate(zip(view.felt, view.wrong, strict=True)):
        if wrong:
            error = f"It sees a wall {_SIDES[side]}: there is none." if felt else f"It misses the wall {_SIDES[side]}."
            y += canvas.paragraph((x + 18, y), error, width - 18, color=palette.RED)
    if view.moment.belief is not None:
        for k in range(60):
            shade = palette.mix(palette.WHITE, palette.BLUE, 0.85 * math.sqrt(k / 59))
            canvas.box((x + 18 + 3 * k, 378), (x + 21 + 3 * k, 390), shade)
        canvas.text((x + 18, 400), "0%", 13, palette.FAINT)
        canvas.text((x + 198, 400), "100%", 13, palette.FAINT, "rm")
        canvas.text((x + 212, 384), "how probable its place is", 14, palette.FAINT, width=width - 212)
        if view.headed:
            canvas.text((x + 212, 401), "triangles: where it may face", 14, palette.FAINT, width=width - 212)
    elif not view.moment.state_shown:
        canvas.paragraph((x + 18, 376), "Where it is stays hidden.", width - 18, color=palette.BLUE)


def text(moment: Moment, grid: Grid, look: Look) -> str:
    """A sketch of the moment in a few lines."""
    view = _View(moment, grid, look)
    rows, columns = (1 + max(place) for place in zip(*grid.cells, strict=True))
    sketch = [["#"] * columns for _ in range(rows)]
    for (row, column), mark in zip(grid.cells, grid.marks, strict=True):
        sketch[row][column] = "." if mark == "S" else mark
    if moment.state_shown:
        cell, heading = view.pose(moment.state)
        row, column = grid.cells[cell]
        sketch[row][column] = "^>v<"[heading] if view.headed else "A"
    lines = [f" {''.join(row)}" for row in sketch]
    lines[0] += f"  {view.message().text}"
    lines.append(f" {tabular_drawing.status(moment)}")
    wrong = [side for side, is_wrong in zip(_SIDES, view.wrong, strict=True) if is_wrong]
    if wrong:
        lines.append(f" wrong about the wall {', '.join(wrong)}")
    if moment.belief is not None:
        lines.append(f" belief: {tabular_drawing.likely(moment.pomdp.state_names, moment.belief)}")
    return "\n".join(lines)
