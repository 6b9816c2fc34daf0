"""Pictures of the T-maze, for people who have never heard of it, and a sketch of it in text."""

from __future__ import annotations

from dataclasses import dataclass

from dpsearch.env_kit.drawing import palette
from dpsearch.env_kit.drawing.canvas import Canvas, Frame, Point
from dpsearch.env_kit.drawing.scene import WIDTH, Icon, Message, agent, arrow, stage
from dpsearch.pomdp import cards as tabular_drawing
from dpsearch.pomdp.env import Moment

_SLOTS = 13  # cells that fit side by side, a gap counting as one
_EDGE, _AROUND = 2, 3  # cells shown at either end of a long corridor, and on either side of the agent
_MIDDLE, _MAZE_WIDTH, _CELL = 262, 840, 76.0  # height of the corridor, most it may be wide, largest cell

_UP, _DOWN = (0.0, -1.0), (0.0, 1.0)
_DIRECTIONS: dict[str, Point] = {"north": _UP, "east": (1.0, 0.0), "south": _DOWN, "west": (-1.0, 0.0)}


@dataclass(frozen=True)
class _View:
    """A moment of the T-maze, for its drawing.

    Attributes:
        moment: The moment that is drawn.
        corridor_length: Position of the junction.
        position: Place of the agent, or its last place before it left through an arm.
        sign: "up" or "down".
        arm: Arm through which the agent has left, "north" or "south"; None while it is in the corridor.
    """

    moment: Moment
    corridor_length: int
    position: int
    sign: str
    arm: str | None

    @classmethod
    def of(cls, moment: Moment) -> _View:
        """Reads the state, numbered as ``tmaze_pomdp`` says."""
        cells = moment.pomdp.n_states // 2 - 2
        over = moment.state >= 2 * cells
        sign, place = divmod(moment.state - 2 * cells, 2) if over else divmod(moment.state, cells)
        arm = ("north", "south")[place] if over else None
        return cls(moment, cells - 1, cells - 1 if over else place, ("up", "down")[sign], arm)

    @property
    def goal(self) -> str:
        """The arm that the sign points to."""
        return "north" if self.sign == "up" else "south"

    @property
    def sign_is_shown(self) -> bool:
        """Whether the agent sees the sign right now."""
        return self.moment.sees.startswith("sign")

    @property
    def sign_is_known(self) -> bool:
        """Whether the spectator may know where the sign points."""
        return self.sign_is_shown or self.moment.state_shown

    @property
    def belief(self) -> float | None:
        """Probability that the sign points up; None if the spectator may not know."""
        if self.moment.belief is None:
            return None
        cells = self.corridor_length + 1
        return float(self.moment.belief[:cells].sum() + self.moment.belief[2 * cells : 2 * cells + 2].sum())

    def prize(self, arm: str) -> str:
        """Reward in an arm, as far as the spectator may know."""
        if not self.sign_is_known:
            return "?"
        return f"{self._paid(arm):+g}"

    def _paid(self, arm: str) -> float:
        """Reward for turning into an arm, which the model pays on reaching the ended state of sign and arm."""
        pomdp = self.moment.pomdp
        state = 2 * (self.corridor_length + 1) + 2 * (self.sign == "down") + (arm == "south")
        row = (pomdp.transitions.columns == state) & ~pomdp.terminal[
            pomdp.transitions.row_of_entry() // pomdp.n_actions
        ]
        return float(pomdp.rewards[row.argmax()])

    def message(self) -> Message:
        """Sentence about the moment."""
        if self.arm is not None and not self.sign_is_known:
            return Message(f"The agent turned {self.arm}.")
        if self.arm is not None:
            paid = self._paid(self.arm) == max(self._paid("north"), self._paid("south"))
            verdict, color = ("right", palette.GREEN) if paid else ("wrong", palette.RED)
            outcome = f"{verdict}, {self.prize(self.arm)}"
            return Message(f"The sign pointed {self.sign}, the agent turned {self.arm}: {outcome}.", color)
        if self.moment.step >= self.moment.max_steps:
            return Message("Time is up.", palette.RED)
        if self.sign_is_shown:
            return Message(f"The road sign points {self.sign}. It is shown only now.", palette.BLUE)
        if self.position == self.corridor_length:
            return Message("The junction. Which way did the sign point?")
        return Message("The sign is out of sight, and must be remembered until the junction.")


def visible_cells(corridor_length: int, position: int) -> list[int | None]:
    """The corridor's cells from left to right as they are drawn, None for a gap that leaves cells out.

    The number of cells depends on the corridor's length alone, so that pictures of an episode do not jump.
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


def picture(moment: Moment) -> Frame:
    """A picture of the moment, ``(HEIGHT, WIDTH, 3)``."""
    view = _View.of(moment)
    aim = "Remember the road sign, walk to the junction, turn the way it pointed."
    did = None if moment.last_action is None else arrow(_DIRECTIONS[moment.did])
    canvas = stage("T-maze", aim, view.message(), tabular_drawing.cards(moment, _bits(moment), did, digits=1))
    _maze(canvas, view)
    return canvas.frame()


def _bits(moment: Moment) -> Icon:
    """Draws the inputs as black and white squares."""
    inputs = moment.inputs

    def draw(canvas: Canvas, center: Point) -> None:
        for k, bit in enumerate(inputs):
            x, y = center[0] + 17 * (k - (len(inputs) - 1) / 2), center[1]
            canvas.box((x - 7, y - 7), (x + 7, y + 7), palette.INK if bit else palette.WHITE, palette.INK, 2)

    return Icon(17 * len(inputs) - 1, draw)


def _maze(canvas: Canvas, view: _View) -> None:
    cells = visible_cells(view.corridor_length, view.position)
    size = min(_MAZE_WIDTH / len(cells), _CELL)
    left = (WIDTH - size * len(cells)) / 2
    centers = [(left + (i + 0.5) * size, float(_MIDDLE)) for i in range(len(cells))]
    for cell, (x, y) in zip(cells, centers, strict=True):
        if cell is None:
            for dot in (-1, 0, 1):
                canvas.disc((x + dot * size / 4, y), size / 16, palette.FAINT)
            continue
        _cell(canvas, (x, y), size, palette.SAND)
        junction = cell == view.corridor_length
        label = (x + size * 0.6, y) if junction else (x, y + size * 0.66)
        canvas.text(label, str(cell), 13, palette.FAINT, "lm" if junction else "mm")
    x, y = centers[-1]
    arms = {"north": (x, y - size), "south": (x, y + size)}
    right, wrong = (palette.GREEN, palette.MINT), (palette.RED, palette.ROSE)
    unknown = (palette.FAINT, palette.SAND)
    for arm, center in arms.items():
        prize = view.prize(arm)
        color, entered = unknown if not view.sign_is_known else right if arm == view.goal else wrong
        _cell(canvas, center, size, entered if arm == view.arm else palette.SAND)
        canvas.text(center, prize, round(size / 3.4), color, "mm")
    _sign(canvas, view, centers[0], size)
    at = centers[cells.index(view.position)] if view.arm is None else arms[view.arm]
    agent(canvas, at, size * 0.3)


def _cell(canvas: Canvas, center: Point, size: float, fill: str) -> None:
    (x, y), half = center, size / 2
    canvas.box((x - half, y - half), (x + half, y + half), fill, palette.LINE)


def _sign(canvas: Canvas, view: _View, start: Point, size: float) -> None:
    """Draws the sign: a board on a post beside the start, grey once the agent can no longer see it."""
    half = size * 0.36
    x, y = start[0], start[1] - size * 1.1
    color = palette.BLUE if view.sign_is_shown else palette.LINE
    canvas.line((x, y), (x, start[1] - size / 2), color, 5)
    canvas.box((x - half, y - half), (x + half, y + half), color, radius=6)
    if view.sign_is_known:
        canvas.arrow((x, y), _UP if view.sign == "up" else _DOWN, half * 1.5, palette.WHITE)
    else:
        canvas.text((x, y), "?", round(half * 1.3), palette.WHITE, "mm")
    if view.belief is not None:
        text = f"belief: up {tabular_drawing.percent(view.belief)}"
        canvas.text((x, y - half - 26), text, 14, palette.BLUE, "mm")
        tabular_drawing.bar(canvas, (x - 30, y - half - 15), (60, 8), view.belief)


def text(moment: Moment) -> str:
    """A sketch of the moment in four lines, and a fifth for the belief if it is shown."""
    view = _View.of(moment)
    cells = visible_cells(view.corridor_length, view.position)
    marks = ["..." if cell is None else "." for cell in cells]
    marks[0] = "S"
    if view.arm is None:
        marks[cells.index(view.position)] = "A"
    corridor = " ".join(marks)
    margin = " " * (len(corridor) + 1)
    north, south = (("A " if arm == view.arm else "") + view.prize(arm) for arm in ("north", "south"))
    lines = [
        f"{margin}{north}",
        f" {corridor}|  {view.message().text}",
        f"{margin}{south}",
        f" sign {view.sign if view.sign_is_known else '?'}, {tabular_drawing.status(moment, digits=1)}",
    ]
    if view.belief is not None:
        lines.append(f" belief: the sign pointed up {view.belief:.1%}, down {1 - view.belief:.1%}")
    return "\n".join(lines)
