"""The 89-state maze, also known as Hallway2: find the goal with legs and eyes that cannot be relied upon.

::

        +---+---+---+---+---+
        | 0   1   2   3   4 |
    +---+   +---+   +---+   +---+
    | 5   6 |   | 7 |   | 8   9 |
    +---+   +   +   +   +   +---+
        |10 |   |11 |   |12 |
    +---+   +   +   +   +   +---+
    |13  14 |   |15 |   |16   G |
    +---+   +---+   +---+   +---+
        |17  18  19  20  21 |
        +---+---+---+---+---+

- *Start:* any of the 22 numbered cells and any of the four headings, equally likely.
- *Actions:* 0 forward, 1 turn left, 2 turn right, 3 turn about, 4 do nothing. Their effects, by probability:

  ============  ===================================================================================================
  forward       0.8 to the cell ahead; 0.05 stays; 0.05 to the cell on the left, now facing left; 0.05 to the cell
                on the right, now facing right; 0.025 to the cell behind; 0.025 to that cell, turned about. Where a wall
                is in the way, the agent stays as it was
  turn left     0.7 left, 0.1 right, 0.1 about, 0.1 no turn
  turn right    0.7 right, 0.1 left, 0.1 about, 0.1 no turn
  turn about    0.6 about, 0.15 left, 0.15 right, 0.1 no turn
  do nothing    stays
  ============  ===================================================================================================

- *Observations:* whether there is a wall in front, on the right, behind and on the left: four bits, 1 for a wall. A
  wall is seen with probability 0.9; where there is none, one is seen with probability 0.05, each bit by itself.
- *Rewards:* 1 for reaching the goal, G; else 0.
- *End:* at the goal, or after 251 steps.
- *Optimum:* all episodes reach the goal, half of them in 25 steps (in 12 if the agent knew where it is). With random
  actions, 22% do.

Sources: M. L. Littman, A. R. Cassandra and L. P. Kaelbling, "Learning policies for partially observable environments:
scaling up", ICML 1995; the thesis, section 3.4.3.
"""

from __future__ import annotations

import itertools

import numpy as np

from dpsearch.env_kit.drawing.canvas import Frame
from dpsearch.env_kit.vector_env import VectorOf
from dpsearch.envs.drawings import maze as maze_drawing
from dpsearch.pomdp.distributions import Distributions
from dpsearch.pomdp.env import TabularEnv
from dpsearch.pomdp.grid import DIRECTIONS, EAST, Grid, walls_seen
from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.task import TabularTask, tabular_task

MAP = (
    "#.....#",
    "..#.#..",
    "#.#.#.#",
    "..#.#.G",
    "#.....#",
)
GRID = Grid.read(MAP)
CELLS = GRID.cells
"""Row and column of each cell; state ``s`` is in cell ``s // 4``, the goal's too."""
HEADINGS = DIRECTIONS
"""State ``s`` faces ``HEADINGS[s % 4]``, except for the goal, which has no heading."""
GOAL = 4 * GRID.marks.index("G")
"""The state of arrival, 88."""
ACTIONS = ("forward", "turn left", "turn right", "turn about", "do nothing")
FORWARD, TURN_LEFT, TURN_RIGHT, TURN_ABOUT, DO_NOTHING = range(5)
SIDES = ("front", "right", "back", "left")
FRONT, RIGHT, BACK, LEFT = range(4)
BITS = np.array(tuple(itertools.product((0, 1), repeat=4)))
"""The agent's input for each symbol, ``(16, 4)``: the binary digits of its number."""
SYMBOLS = tuple(walls_seen(SIDES, bits) for bits in BITS)

WALL_SEEN, PHANTOM_SEEN = 0.9, 0.05
"""Probability that a wall is seen, where there is one and where there is none."""
LIMIT = 251

REWARD_THRESHOLD = 0.95
"""Of 100 episodes 95 reach the goal, as in the thesis's best result."""

# Effects of each action: probability, side moved to or None, quarter turns to the right.
_OUTCOMES: tuple[tuple[tuple[float, int | None, int], ...], ...] = (
    (
        (0.8, FRONT, 0),
        (0.05, None, 0),
        (0.05, LEFT, LEFT),
        (0.05, RIGHT, RIGHT),
        (0.025, BACK, 0),
        (0.025, BACK, BACK),
    ),
    ((0.7, None, LEFT), (0.1, None, 0), (0.1, None, RIGHT), (0.1, None, BACK)),
    ((0.7, None, RIGHT), (0.1, None, 0), (0.1, None, LEFT), (0.1, None, BACK)),
    ((0.6, None, BACK), (0.15, None, LEFT), (0.15, None, RIGHT), (0.1, None, 0)),
    ((1.0, None, 0),),
)


def maze89_pomdp() -> TabularPOMDP:
    """The maze as tables.

    State ``4 * cell + heading``, with cells as drawn above and headings 0 north, 1 east, 2 south, 3 west; and 88, the
    goal, where walls are seen as by someone who has just come in.
    """
    entries = [
        (state, action, _arrival(state, side, turns), probability)
        for state in range(GOAL)
        for action, outcomes in enumerate(_OUTCOMES)
        for probability, side, turns in outcomes
    ]
    states, actions, next_states, probabilities = (np.array(column) for column in zip(*entries, strict=True))
    cell, heading = np.divmod(np.arange(GOAL + 1), 4)
    heading[GOAL] = EAST  # the only way in
    walls = GRID.walls[cell[:, None], (heading[:, None] + np.arange(4)) % 4]  # (S, 4), by side
    pattern = walls @ [8, 4, 2, 1]  # (S,): the symbol seen without noise
    wall_seen = np.where(BITS == 1, WALL_SEEN, PHANTOM_SEEN)[:, None]  # (16, 1, 4)
    seen = np.where(BITS == 1, wall_seen, 1.0 - wall_seen).prod(axis=2)  # (pattern, symbol)
    start = np.full(GOAL + 1, 1.0 / GOAL)
    start[GOAL] = 0.0
    return TabularPOMDP.from_entries(
        shape=(GOAL + 1, len(ACTIONS)),
        start=start,
        states=states,
        actions=actions,
        next_states=next_states,
        probabilities=probabilities,
        rewards=np.where(next_states == GOAL, 1.0, 0.0),
        terminal=[GOAL],
        observations=Distributions.from_dense(seen),
        observation_row=pattern[:, None],
        first_observation_row=pattern,
        features=BITS,
        discount=0.98,
        state_names=(*(f"cell {s // 4}, facing {HEADINGS[s % 4]}" for s in range(GOAL)), "goal"),
        action_names=ACTIONS,
        observation_names=SYMBOLS,
    )


def _arrival(state: int, side: int | None, turns: int) -> int:
    """The state after going to the cell on a side, unless that is None, and then turning right some quarters."""
    cell, heading = divmod(state, 4)
    if side is not None:
        direction = (heading + side) % 4
        if GRID.walls[cell, direction]:
            return state
        cell = int(GRID.neighbours[cell, direction])
    return min(4 * cell + (heading + turns) % 4, GOAL)  # all headings are one at the goal, the last cell


class Maze89(TabularEnv):
    """One 89-state maze, as drawn above.

    Args:
        max_episode_steps: Steps after which an episode is cut off; 251 by default.
        render_mode: "rgb_array", "human" (needs pygame), "ansi" (text) or None.
        reveal: Secrets that drawings show: "state", "belief" or "nothing"; see :class:`TabularEnv`.

    Raises:
        ValueError: If an argument is not accepted.
    """

    def __init__(
        self, max_episode_steps: int | None = None, render_mode: str | None = None, reveal: str = "state"
    ) -> None:
        super().__init__(self.make_task(max_episode_steps), render_mode, reveal)

    @classmethod
    def make_task(cls, max_episode_steps: int | None = None) -> TabularTask:
        """The task that the class plays with these arguments."""
        return tabular_task(maze89_pomdp(), LIMIT if max_episode_steps is None else max_episode_steps, REWARD_THRESHOLD)

    def picture(self) -> Frame:
        """The moment as a picture, ``(540, 960, 3)``."""
        return maze_drawing.picture(self.moment(), GRID, maze_drawing.MAZE89)

    def text(self) -> str:
        """The moment in a few lines of text."""
        return maze_drawing.text(self.moment(), GRID, maze_drawing.MAZE89)


class Maze89Vector(VectorOf):
    """Many :class:`Maze89`."""

    scalar = Maze89
