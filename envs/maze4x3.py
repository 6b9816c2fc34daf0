"""Parr and Russell's 4x3 maze: cross a slippery little world, seeing only the walls on the left and right.

::

    +---+---+---+---+
    | 0 | 1 | 2 | + |    1, the end
    +---+---+---+---+
    | 3 |###| 4 | - |    -1
    +---+---+---+---+
    | 5 | 6 | 7 | 8 |
    +---+---+---+---+

- *Start:* any of the nine numbered cells, equally likely.
- *Actions:* 0 north, 1 east, 2 south, 3 west. The agent moves there with probability 0.8, and to either side of there
  with probability 0.1. It stays where it is if that way is blocked, by the outer walls or by the rock in the middle.
- *Observations:* one-hot of six: a wall to the left (west) only, to the right (east) only, to neither side, to both
  sides, at ``+``, at ``-``.
- *Rewards:* 1 for a step that ends in ``+``, -1 for one that ends in ``-``, even if it began there, else -0.04.
- *End:* in ``+``, with ``minus_ends=True`` also in ``-``, or after 100 steps.
- *Optimum:* 0.762, or 0.698 with ``minus_ends=True``. Random actions earn -1.96, or -1.10.

Sources: R. Parr and S. Russell, "Approximating optimal policies for partially observable stochastic domains", IJCAI
1995; the thesis, section 6.3.4.
"""

from __future__ import annotations

import numpy as np

from dpsearch.envs import maze_drawing
from dpsearch.envs.distributions import Distributions
from dpsearch.envs.drawing import Frame
from dpsearch.envs.grid import DIRECTIONS, EAST, WEST, Grid
from dpsearch.envs.kernel_vector_env import VectorOf
from dpsearch.envs.tabular import TabularPOMDP, TabularTask
from dpsearch.envs.tabular_env import TabularEnv

MAP = (
    "...+",
    ".#.-",
    "....",
)
GRID = Grid.read(MAP)
CELLS = GRID.cells
"""Row and column of each state."""
PLUS, MINUS = GRID.marks.index("+"), GRID.marks.index("-")
ACTIONS = DIRECTIONS
SYMBOLS = ("wall left", "wall right", "no walls", "both walls", "at +", "at -")
WALL_LEFT, WALL_RIGHT, NO_WALLS, BOTH_WALLS, AT_PLUS, AT_MINUS = range(6)

STRAIGHT, SIDEWAYS = 0.8, 0.1
"""Probability of moving as intended, and to either side of that."""
LIMIT = 100

REWARD_THRESHOLD = 0.7
"""The mean of 100 episodes of the optimal policy is 0.76 with a standard deviation of 0.03."""
THRESHOLD_IF_MINUS_ENDS = 0.6
"""Likewise: 0.70 with a standard deviation of 0.05."""


def maze4x3_pomdp(minus_ends: bool = False) -> TabularPOMDP:
    """The maze as tables; states are numbered as drawn above, with 9 for ``+`` and 10 for ``-``.

    Args:
        minus_ends: Whether an episode ends in ``-``.

    Raises:
        ValueError: If ``minus_ends`` is not a bool.
    """
    if not isinstance(minus_ends, bool):
        raise ValueError(f"minus_ends must be True or False, got {minus_ends!r}")
    n = len(CELLS)
    cell, action, slip = np.ogrid[:n, :4, -1:2]  # slip: a quarter turn to the left, none, one to the right
    next_cell = GRID.neighbours[cell, (action + slip) % 4]  # (n, 4, 3)
    earned = np.full(n, -0.04)  # for a step that ends in a cell
    earned[[PLUS, MINUS]] = 1.0, -1.0
    left, right = GRID.walls[:, WEST], GRID.walls[:, EAST]
    seen = np.select([left & right, left, right], [BOTH_WALLS, WALL_LEFT, WALL_RIGHT], NO_WALLS)
    seen[[PLUS, MINUS]] = AT_PLUS, AT_MINUS
    start = np.full(n, 1.0 / (n - 2))
    start[[PLUS, MINUS]] = 0.0
    return TabularPOMDP.from_entries(
        shape=(n, len(ACTIONS)),
        start=start,
        states=cell,
        actions=action,
        next_states=next_cell,
        probabilities=np.where(slip == 0, STRAIGHT, SIDEWAYS),
        rewards=earned[next_cell],
        terminal=[PLUS, MINUS] if minus_ends else [PLUS],
        observations=Distributions.from_dense(np.eye(len(SYMBOLS))),
        observation_row=seen[:, None],
        first_observation_row=seen,
        discount=1.0,
        state_names=(*(f"cell {i}" for i in range(n - 2)), "+", "-"),
        action_names=ACTIONS,
        observation_names=SYMBOLS,
    )


class Maze4x3(TabularEnv):
    """One 4x3 maze, as drawn above.

    Args:
        minus_ends: Whether an episode ends in ``-``.
        max_episode_steps: Steps after which an episode is cut off; 100 by default.
        render_mode: "rgb_array", "human" (needs pygame), "ansi" (text) or None.
        reveal: What drawings show; see :class:`TabularEnv`.

    Attributes:
        minus_ends: Whether an episode ends in ``-``.

    Raises:
        ValueError: If an argument is none of these.
    """

    def __init__(
        self,
        minus_ends: bool = False,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        reveal: str = "state",
    ) -> None:
        super().__init__(self.make_task(minus_ends, max_episode_steps), render_mode, reveal)
        self.minus_ends = minus_ends

    @classmethod
    def make_task(cls, minus_ends: bool = False, max_episode_steps: int | None = None) -> TabularTask:
        """What the class plays with these arguments."""
        limit = LIMIT if max_episode_steps is None else max_episode_steps
        return maze4x3_pomdp(minus_ends).task(limit, THRESHOLD_IF_MINUS_ENDS if minus_ends else REWARD_THRESHOLD)

    def picture(self) -> Frame:
        """The moment as a picture, ``(540, 960, 3)``."""
        return maze_drawing.picture(self.moment(), GRID, maze_drawing.MAZE4X3)

    def text(self) -> str:
        """The moment in a few lines of text."""
        return maze_drawing.text(self.moment(), GRID, maze_drawing.MAZE4X3)


class Maze4x3Vector(VectorOf):
    """Many :class:`Maze4x3`."""

    scalar = Maze4x3
