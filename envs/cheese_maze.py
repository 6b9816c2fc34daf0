"""McCallum's cheese maze: find the cheese where one place looks like another.

::

    +---+---+---+---+---+
    | 0   1   2   3   4 |
    +   +---+   +---+   +
    | 5 |   | 6 |   | 7 |
    +   +   +   +   +   +
    | 8 |   | 9 |   |10 |
    +---+   +---+   +---+
      S       T       S

- *Start:* a dead end, 8 or 10, equally likely; with ``start="anywhere"`` any cell but the cheese's.
- *Actions:* 0 north, 1 east, 2 south, 3 west, all reliable. Whoever walks into a wall stays where it is.
- *Observations:* whether there is a wall to the north, east, south and west: 1 for a wall, -1 for none. There are six
  such patterns: cells 1 and 3 look the same, 5, 6 and 7 do, and so do 8, 9 and 10.
- *Rewards:* 1 for reaching the cheese, 9; ``bump_reward`` for walking into a wall, -1 by default; else 0.
- *End:* at the cheese, or after 500 steps.
- *Optimum:* 1, in 6 steps from a dead end and in 4.3 on average from anywhere. Random actions earn -62.5.

The thesis's numbers are those of ``start="anywhere", bump_reward=0``, although its text has the defaults.

Sources: R. A. McCallum, "Overcoming incomplete perception with utile distinction memory", ICML 1993; the thesis,
section 6.3.1.
"""

from __future__ import annotations

import math

import numpy as np

from dpsearch.env_kit.drawing.canvas import Frame
from dpsearch.env_kit.vector_env import VectorOf
from dpsearch.envs.drawings import maze as maze_drawing
from dpsearch.pomdp.distributions import Distributions
from dpsearch.pomdp.env import TabularEnv
from dpsearch.pomdp.grid import DIRECTIONS, Grid, walls_seen
from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.task import TabularTask, tabular_task

MAP = (
    ".....",
    ".#.#.",
    "S#T#S",
)
GRID = Grid.read(MAP)
CELLS = GRID.cells
"""Row and column of each state."""
CHEESE = GRID.marks.index("T")
ACTIONS = DIRECTIONS
STARTS = {
    "dead_ends": tuple(i for i, mark in enumerate(GRID.marks) if mark == "S"),
    "anywhere": tuple(i for i, mark in enumerate(GRID.marks) if mark != "T"),
}
"""The cells in which an episode may begin."""
PATTERNS = tuple(dict.fromkeys(tuple(walls) for walls in GRID.walls.tolist()))
"""Walls in each direction, for each symbol; in the order in which the cells show them first."""
SYMBOLS = tuple(walls_seen(DIRECTIONS, pattern) for pattern in PATTERNS)

FOUND = 1.0
LIMIT = 500


def cheese_maze_pomdp(start: str = "dead_ends", bump_reward: float = -1.0) -> TabularPOMDP:
    """The maze as tables; states are numbered as drawn above.

    Args:
        start: "dead_ends" or "anywhere".
        bump_reward: Reward for walking into a wall.

    Raises:
        ValueError: If ``start`` is neither, or ``bump_reward`` is not a finite number.
    """
    if start not in STARTS:
        raise ValueError(f"start must be one of {', '.join(STARTS)}, got {start!r}")
    if isinstance(bump_reward, bool) or not isinstance(bump_reward, int | float) or not math.isfinite(bump_reward):
        raise ValueError(f"bump_reward must be a finite number, got {bump_reward!r}")
    n = len(CELLS)
    cell, action = np.ogrid[:n, :4]
    may_start = np.isin(np.arange(n), STARTS[start])
    seen = [PATTERNS.index(tuple(walls)) for walls in GRID.walls.tolist()]
    return TabularPOMDP.from_entries(
        shape=(n, len(ACTIONS)),
        start=may_start / may_start.sum(),
        states=cell,
        actions=action,
        next_states=GRID.neighbours,
        rewards=np.where(GRID.walls, bump_reward, np.where(GRID.neighbours == CHEESE, FOUND, 0.0)),
        terminal=[CHEESE],
        observations=Distributions.from_dense(np.eye(len(SYMBOLS))),
        observation_row=np.array(seen)[:, None],
        first_observation_row=seen,
        features=np.where(PATTERNS, 1.0, -1.0),
        discount=0.7,
        state_names=tuple("cheese" if i == CHEESE else f"cell {i}" for i in range(n)),
        action_names=ACTIONS,
        observation_names=SYMBOLS,
    )


def threshold(bump_reward: float) -> float | None:
    """Mean return that counts as solved: the cheese always found, and a wall met in one episode of ten.

    There is no such return unless walls cost something: whoever walks at random finds the cheese in the end. To reach
    the threshold takes no memory, only care: a policy that walks about at random between walls gets there after 20
    steps. With memory it takes 6, and the discounted return is 0.168 instead of 0.026.
    """
    return FOUND + 0.1 * bump_reward if bump_reward < 0.0 else None


class CheeseMaze(TabularEnv):
    """One cheese maze, as drawn above.

    Args:
        start: "dead_ends" or "anywhere".
        bump_reward: Reward for walking into a wall.
        max_episode_steps: Steps after which an episode is cut off; 500 by default.
        render_mode: "rgb_array", "human" (needs pygame), "ansi" (text) or None.
        reveal: Secrets that drawings show: "state", "belief" or "nothing"; see :class:`TabularEnv`.

    Attributes:
        start: "dead_ends" or "anywhere".
        bump_reward: Reward for walking into a wall.

    Raises:
        ValueError: If an argument is not accepted.
    """

    def __init__(
        self,
        start: str = "dead_ends",
        bump_reward: float = -1.0,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        reveal: str = "state",
    ) -> None:
        super().__init__(self.make_task(start, bump_reward, max_episode_steps), render_mode, reveal)
        self.start = start
        self.bump_reward = bump_reward

    @classmethod
    def make_task(
        cls, start: str = "dead_ends", bump_reward: float = -1.0, max_episode_steps: int | None = None
    ) -> TabularTask:
        """The task that the class plays with these arguments."""
        limit = LIMIT if max_episode_steps is None else max_episode_steps
        return tabular_task(cheese_maze_pomdp(start, bump_reward), limit, threshold(bump_reward))

    def picture(self) -> Frame:
        """The moment as a picture, ``(540, 960, 3)``."""
        return maze_drawing.picture(self.moment(), GRID, maze_drawing.CHEESE_MAZE)

    def text(self) -> str:
        """The moment in a few lines of text."""
        return maze_drawing.text(self.moment(), GRID, maze_drawing.CHEESE_MAZE)


class CheeseMazeVector(VectorOf):
    """Many :class:`CheeseMaze`."""

    scalar = CheeseMaze
