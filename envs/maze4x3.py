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
  with probability 0.1. With ``slips="any_way"`` it may go the opposite way too: of 1000 steps north or east, 655 go
  there and 115 each other way; of 1000 steps south or west, 745 go there, 115 to either side and 25 the opposite way.
  It stays where it is if that way is blocked, by the outer walls or by the rock in the middle.
- *Observations:* one-hot of six: a wall to the left (west) only, to the right (east) only, to neither side, to both
  sides, at ``+``, at ``-``.
- *Rewards:* 1 for a step that ends in ``+``, ``minus_reward`` for one that ends in ``-``, even if it began there, -1 by
  default; else -0.04.
- *End:* in ``+``, with ``minus_ends=True`` also in ``-``, or after 100 steps.
- *Optimum:* 0.762, or 0.698 with ``minus_ends=True``. Random actions earn -1.96, or -1.10.

The thesis's numbers of random actions and of its best policies fit ``slips="any_way", minus_reward=-0.04``, although
its text has the defaults: there random actions have a mean over episodes of the reward per step of 0.056, and the
optimal policy, which earns 0.83, has 0.27; both are as printed. With the defaults it is -0.006 and 0.21.

Sources: R. Parr and S. Russell, "Approximating optimal policies for partially observable stochastic domains", IJCAI
1995; the thesis, section 6.3.4.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dpsearch.env_kit.drawing.canvas import Frame
from dpsearch.env_kit.vector_env import VectorOf
from dpsearch.envs.drawings import maze as maze_drawing
from dpsearch.pomdp.distributions import Distributions
from dpsearch.pomdp.env import TabularEnv
from dpsearch.pomdp.grid import DIRECTIONS, EAST, WEST, Grid
from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.task import TabularTask, tabular_task

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

SLIPS = {
    "sideways": ((0.1, 0.8, 0.1, 0.0),) * 4,
    "any_way": ((0.115, 0.655, 0.115, 0.115),) * 2 + ((0.115, 0.745, 0.115, 0.025),) * 2,
}
"""For each action, the probabilities of moving a quarter turn to the left of it, in its direction, to the right, and
back.

"any_way" is the task as the authors of the thesis once published it. There each rival of an action takes its place with
probability 0.1, and then any action does with 0.1. Rivals were to be all but the opposite direction, it seems, but by a
slip of operator precedence none is left out for north and east. So 0.655 is 0.9 * 0.7 + 0.1 / 4, and 0.115 is 0.9 * 0.1
+ 0.1 / 4.
"""
STEP, MINUS_REWARD = -0.04, -1.0
LIMIT = 100

THRESHOLDS = {
    ("sideways", MINUS_REWARD, False): 0.7,
    ("sideways", MINUS_REWARD, True): 0.6,
    ("any_way", STEP, False): 0.78,
}
"""Mean return that counts as solved, by slips, minus_reward and minus_ends. Means of 100 episodes of the optimal
policies are 0.76, 0.70 and 0.83, with standard deviations of 0.03, 0.05 and 0.01."""


def maze4x3_pomdp(
    minus_ends: bool = False, slips: str = "sideways", minus_reward: float = MINUS_REWARD
) -> TabularPOMDP:
    """The maze as tables; states are numbered as drawn above, with 9 for ``+`` and 10 for ``-``.

    Args:
        minus_ends: Whether an episode ends in ``-``.
        slips: "sideways" or "any_way".
        minus_reward: Reward of a step that ends in ``-``.

    Raises:
        ValueError: If ``minus_ends`` is not a bool, ``slips`` neither, or ``minus_reward`` not a finite number.
    """
    if not isinstance(minus_ends, bool):
        raise ValueError(f"minus_ends must be True or False, got {minus_ends!r}")
    if slips not in tuple(SLIPS):
        raise ValueError(f"slips must be one of {', '.join(SLIPS)}, got {slips!r}")
    if isinstance(minus_reward, bool) or not isinstance(minus_reward, int | float) or not math.isfinite(minus_reward):
        raise ValueError(f"minus_reward must be a finite number, got {minus_reward!r}")
    n = len(CELLS)
    cell, ways = np.arange(n)[:, None], np.array(SLIPS[slips])
    action, way = np.nonzero(ways)  # (K,): those that may happen
    next_cell = GRID.neighbours[cell, (action + way - 1) % 4]  # (n, K)
    earned = np.full(n, STEP)  # reward of a step that ends in each cell
    earned[[PLUS, MINUS]] = 1.0, minus_reward
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
        probabilities=ways[action, way],
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
        slips: "sideways" or "any_way".
        minus_reward: Reward of a step that ends in ``-``.
        max_episode_steps: Steps after which an episode is cut off; 100 by default.
        render_mode: "rgb_array", "human" (needs pygame), "ansi" (text) or None.
        reveal: Secrets that drawings show: "state", "belief" or "nothing"; see :class:`TabularEnv`.

    Attributes:
        minus_ends: Whether an episode ends in ``-``.
        slips: "sideways" or "any_way".
        minus_reward: Reward of a step that ends in ``-``.

    Raises:
        ValueError: If an argument is not accepted.
    """

    def __init__(
        self,
        minus_ends: bool = False,
        slips: str = "sideways",
        minus_reward: float = MINUS_REWARD,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        reveal: str = "state",
    ) -> None:
        super().__init__(self.make_task(minus_ends, slips, minus_reward, max_episode_steps), render_mode, reveal)
        self.minus_ends = minus_ends
        self.slips = slips
        self.minus_reward = minus_reward

    @classmethod
    def make_task(
        cls,
        minus_ends: bool = False,
        slips: str = "sideways",
        minus_reward: float = MINUS_REWARD,
        max_episode_steps: int | None = None,
    ) -> TabularTask:
        """The task that the class plays with these arguments."""
        limit = LIMIT if max_episode_steps is None else max_episode_steps
        threshold = THRESHOLDS.get((slips, minus_reward, minus_ends))
        return tabular_task(maze4x3_pomdp(minus_ends, slips, minus_reward), limit, threshold)

    def picture(self) -> Frame:
        """The moment as a picture, ``(540, 960, 3)``."""
        return maze_drawing.picture(self.moment(), GRID, self._look())

    def text(self) -> str:
        """The moment in a few lines of text."""
        return maze_drawing.text(self.moment(), GRID, self._look())

    def _look(self) -> maze_drawing.Look:
        """The words of the drawing."""
        look = maze_drawing.MAZE4X3
        if self.slips == "any_way":
            often = "2 times out of 3 it goes where it wants to, to the south and west 3 times out of 4. Else it slips."
            look = replace(look, rules=(look.rules[0], often, look.rules[2]))
        if self.minus_reward == STEP:
            look = replace(look, aim="Reach +1. Any other step costs 0.04.", minus="-")
        elif self.minus_reward != MINUS_REWARD:
            minus = f"{self.minus_reward:+g}"
            look = replace(look, aim=look.aim.replace("-1", minus), minus=minus)
        return look


class Maze4x3Vector(VectorOf):
    """Many :class:`Maze4x3`."""

    scalar = Maze4x3
