"""The T-maze: keep one bit in mind for the length of a corridor.

::

      sign                               +----+
      [^v]                               | +4 |  or -0.1, as the sign pointed
    +------+-----+-----+- - - -+---------+----+
    |  0   |  1  |  2  |       |  N - 1  | N  |
    +------+-----+-----+- - - -+---------+----+
                                         |-0.1|  or +4
                                         +----+

- *Start:* position 0, where a road sign points up or down, equally likely. It is shown on the first step
  only: coming back to position 0 shows corridor.
- *Actions:* 0 north, 1 east, 2 south, 3 west. East and west move.
- *Observations:* sign up, sign down, corridor or junction. By default three bits, as Bakker has them: sign up
  ``0 1 1``, sign down ``1 1 0``, corridor ``1 0 1``, junction ``0 1 0``; one-hot on request.
- *Rewards:* -0.1 for walking into a wall, and the agent stays. At the junction, north or south earns 4 where
  the sign pointed, and -0.1 otherwise (``wrong_turn_reward``). All else earns 0.
- *End:* north or south at the junction; or the limit of max(1000, 10 (N + 1)) steps.
- *Optimum:* 4 in N + 1 steps. Without memory half of the turns are wrong: 1.95.

Source: B. Bakker, "Reinforcement learning with long short-term memory", NIPS 14, 2002.
"""

from __future__ import annotations

import math
from operator import index

import numpy as np

from dpsearch.env_kit.drawing.canvas import Frame
from dpsearch.env_kit.vector_env import VectorOf
from dpsearch.envs.drawings import tmaze as tmaze_drawing
from dpsearch.pomdp.distributions import Distributions
from dpsearch.pomdp.env import TabularEnv
from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.task import TabularTask, tabular_task

ACTIONS = ("north", "east", "south", "west")
NORTH, EAST, SOUTH, WEST = range(4)
SYMBOLS = ("sign up", "sign down", "corridor", "junction")
SIGN_UP, SIGN_DOWN, CORRIDOR, JUNCTION = range(4)
LONGEST = 100_000
RIGHT_TURN, WRONG_TURN, BUMP = 4.0, -0.1, -0.1
REWARD_THRESHOLD = 3.8
"""Mean return that counts as solved: at least 96 of 100 signs remembered."""

ENCODINGS = {
    "bits": ((0, 1, 1), (1, 1, 0), (1, 0, 1), (0, 1, 0)),
    "one_hot": ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)),
}


def tmaze_pomdp(
    corridor_length: int = 10, encoding: str = "bits", wrong_turn_reward: float = WRONG_TURN
) -> TabularPOMDP:
    """The T-maze as tables.

    State ``sign * (N + 1) + position``, sign 0 for up and 1 for down, and four states for ended episodes,
    ``2 (N + 1) + 2 sign + arm``, arm 0 for north and 1 for south; there the junction is still in sight.

    Args:
        corridor_length: N, the position of the junction, from 1 to 100,000.
        encoding: Encoding of symbols: "bits" or "one_hot".
        wrong_turn_reward: Reward of the turn against the sign.

    Raises:
        ValueError: If an argument is not accepted.
    """
    n = _checked_length(corridor_length)
    if not math.isfinite(wrong_turn_reward):
        raise ValueError(f"wrong_turn_reward must be finite, got {wrong_turn_reward!r}")
    if encoding not in ENCODINGS:
        raise ValueError(f"encoding must be one of {', '.join(ENCODINGS)}, got {encoding!r}")
    over = 2 * (n + 1)  # the first of the ended states
    sign, position, action = np.ogrid[:2, : n + 1, :4]
    state = sign * (n + 1) + position  # (2, N + 1, 1)
    turns = (position == n) & ((action == NORTH) | (action == SOUTH))
    walks = ((action == EAST) & (position < n)) | ((action == WEST) & (position > 0))
    arm = np.where(action == SOUTH, 1, 0)
    next_state = np.where(walks, state + np.where(action == EAST, 1, -1), state)
    next_state = np.where(turns, over + 2 * sign + arm, next_state)

    seen = np.full(over + 4, CORRIDOR)
    seen[[n, 2 * n + 1]] = seen[over:] = JUNCTION
    seen_first = seen.copy()
    seen_first[[0, n + 1]] = SIGN_UP, SIGN_DOWN
    start = np.zeros(over + 4)
    start[[0, n + 1]] = 0.5
    return TabularPOMDP.from_entries(
        shape=(over + 4, len(ACTIONS)),
        start=start,
        states=state,
        actions=action,
        next_states=next_state,
        rewards=np.where(turns, np.where(arm == sign, RIGHT_TURN, wrong_turn_reward), np.where(walks, 0.0, BUMP)),
        terminal=np.arange(over, over + 4),
        observations=Distributions.from_dense(np.eye(len(SYMBOLS))),
        observation_row=seen[:, None],
        first_observation_row=seen_first,
        features=ENCODINGS[encoding],
        discount=0.98,
        action_names=ACTIONS,
        observation_names=SYMBOLS,
    )


def default_limit(corridor_length: int) -> int:
    """Steps after which an episode is cut off unless said otherwise: max(1000, 10 (N + 1))."""
    return max(1000, 10 * (_checked_length(corridor_length) + 1))


def _checked_length(corridor_length: int) -> int:
    try:
        n = -1 if isinstance(corridor_length, bool) else index(corridor_length)
    except TypeError:
        n = -1
    if not 1 <= n <= LONGEST:
        raise ValueError(f"corridor_length must be a whole number from 1 to {LONGEST}, got {corridor_length!r}")
    return n


class TMaze(TabularEnv):
    """One T-maze, as drawn above.

    Args:
        corridor_length: N, the position of the junction, from 1 to 100,000.
        encoding: Encoding of symbols: "bits" or "one_hot".
        wrong_turn_reward: Reward of the turn against the sign. With 4, any turn is right and nothing need be
            remembered: the printed numbers of the thesis's tables 6.1 and 7.2 are those of such a task.
        max_episode_steps: Steps after which an episode is cut off; max(1000, 10 (N + 1)) by default.
        render_mode: "rgb_array", "human" (needs pygame), "ansi" (text) or None.
        reveal: Secrets that drawings show: "state", "belief" or "nothing"; see :class:`TabularEnv`.

    Attributes:
        corridor_length: N, the position of the junction.
        encoding: Encoding of symbols: "bits" or "one_hot".
        wrong_turn_reward: Reward of the turn against the sign.

    Raises:
        ValueError: If an argument is not accepted.
    """

    def __init__(
        self,
        corridor_length: int = 10,
        encoding: str = "bits",
        wrong_turn_reward: float = WRONG_TURN,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        reveal: str = "state",
    ) -> None:
        task = self.make_task(corridor_length, encoding, wrong_turn_reward, max_episode_steps)
        super().__init__(task, render_mode, reveal)
        self.corridor_length = corridor_length
        self.encoding = encoding
        self.wrong_turn_reward = wrong_turn_reward

    @classmethod
    def make_task(
        cls,
        corridor_length: int = 10,
        encoding: str = "bits",
        wrong_turn_reward: float = WRONG_TURN,
        max_episode_steps: int | None = None,
    ) -> TabularTask:
        """The task that the class plays with these arguments."""
        limit = default_limit(corridor_length) if max_episode_steps is None else max_episode_steps
        return tabular_task(tmaze_pomdp(corridor_length, encoding, wrong_turn_reward), limit, REWARD_THRESHOLD)

    def picture(self) -> Frame:
        """The moment as a picture, ``(540, 960, 3)``."""
        return tmaze_drawing.picture(self.moment())

    def text(self) -> str:
        """The moment in a few lines of text."""
        return tmaze_drawing.text(self.moment())


class TMazeVector(VectorOf):
    """Many :class:`TMaze`."""

    scalar = TMaze
