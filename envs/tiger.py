"""The Tiger problem: listen until it is clear enough which door not to open.

::

    +--------+  +--------+
    |  left  |  | right  |    a tiger behind one door, a prize behind the other
    +--------+  +--------+
            agent

- *Start:* the tiger is behind either door, equally likely.
- *Actions:* 0 listen, 1 open the left door, 2 open the right door.
- *Observations:* the tiger is heard on the left, ``1 -1``, or on the right, ``-1 1``. After listening this is right
  with probability 0.85. After opening a door it tells nothing: either is equally likely. Before the first action
  nothing was heard: ``0 0``.
- *Rewards:* -1 for listening, -100 for opening the door with the tiger behind it, 10 for opening the other.
- *End:* after 100 steps. Until then, whenever a door was opened the tiger is put behind either door anew. With
  ``single=True``, opening a door ends the episode.
- *Optimum* of the return discounted by 0.75: listen until one side was heard twice more often than the other, then open
  the other. That earns 106.1 in 100 steps, or 3.99 with ``single=True``. Random actions earn -3033, or -45.5.

Sources: A. R. Cassandra, L. P. Kaelbling and M. L. Littman, "Acting optimally in partially observable stochastic
domains", AAAI 1994; the thesis, section 6.3.2, where it is iterated.
"""

from __future__ import annotations

import numpy as np

from dpsearch.env_kit.drawing.canvas import Frame
from dpsearch.env_kit.vector_env import VectorOf
from dpsearch.envs.drawings import tiger as tiger_drawing
from dpsearch.pomdp.env import TabularEnv
from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.task import TabularTask, tabular_task

ACTIONS = ("listen", "open left", "open right")
LISTEN, OPEN_LEFT, OPEN_RIGHT = range(3)
STATES = ("tiger left", "tiger right", "opened, tiger left", "opened, tiger right")
SYMBOLS = ("heard left", "heard right", "nothing")
HEARD_LEFT, HEARD_RIGHT, NOTHING = range(3)

HEARD_RIGHTLY = 0.85
"""Probability that the tiger is heard where it is."""
LISTENING, TIGER, PRIZE = -1.0, -100.0, 10.0
LIMIT = 100

THRESHOLD_PER_STEP = 0.8
"""Mean reward per step that counts as solved in the iterated problem: 80 in 100 steps.

The return is noisy, for one tiger in a hundred steps costs as much as all the rest earns: its standard deviation is 98
for the optimal policy, that of the mean of 100 episodes 9.8. That policy (106 on average) passes almost always, and so
does the more careful one that waits until one side leads by three (96 on average); one that waits for four (59) fails.
"""
SINGLE_THRESHOLD = 2.0
"""Mean return that counts as solved with ``single=True``.

The mean of 100 episodes of the optimal policy is 4.0, with a standard deviation of 1.9.
"""


def tiger_pomdp(single: bool = False) -> TabularPOMDP:
    """The Tiger problem as tables.

    State 0 is the tiger behind the left door, 1 behind the right one. With ``single`` there are two more, for episodes
    that are over: 2 after the tiger was behind the left door, 3 behind the right one.

    Args:
        single: Whether opening a door ends the episode.

    Raises:
        ValueError: If ``single`` is not a bool.
    """
    if not isinstance(single, bool):
        raise ValueError(f"single must be True or False, got {single!r}")
    n = 4 if single else 2
    transitions = np.stack([np.eye(n)] * 3)  # (action, state, next state)
    observations = np.full((3, n, 2), 0.5)  # (action, next state, symbol)
    rewards = np.full((3, n, 1), LISTENING)
    for tiger in range(2):
        observations[LISTEN, tiger] = 1.0 - HEARD_RIGHTLY
        observations[LISTEN, tiger, tiger] = HEARD_RIGHTLY
        for side, door in enumerate((OPEN_LEFT, OPEN_RIGHT)):
            transitions[door, tiger] = np.eye(n)[2 + tiger] if single else 0.5
            rewards[door, tiger] = TIGER if side == tiger else PRIZE
    return TabularPOMDP.from_dense(
        transitions,
        observations,
        rewards,
        start=np.array([0.5, 0.5, 0.0, 0.0])[:n],
        features=[[1, -1], [-1, 1]],
        terminal=range(2, n),
        discount=0.75,
        state_names=STATES[:n],
        action_names=ACTIONS,
        observation_names=SYMBOLS[:NOTHING],  # from_dense adds "nothing", all zeros, for the start
    )


class Tiger(TabularEnv):
    """One Tiger problem, as described above.

    Args:
        single: Whether opening a door ends the episode.
        max_episode_steps: Steps after which an episode is cut off; 100 by default.
        render_mode: "rgb_array", "human" (needs pygame), "ansi" (text) or None.
        reveal: Secrets that drawings show: "state", "belief" or "nothing"; see :class:`TabularEnv`.

    Attributes:
        single: Whether opening a door ends the episode.

    Raises:
        ValueError: If an argument is not accepted.
    """

    def __init__(
        self,
        single: bool = False,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        reveal: str = "state",
    ) -> None:
        super().__init__(self.make_task(single, max_episode_steps), render_mode, reveal)
        self.single = single

    @classmethod
    def make_task(cls, single: bool = False, max_episode_steps: int | None = None) -> TabularTask:
        """The task that the class plays with these arguments."""
        limit = LIMIT if max_episode_steps is None else max_episode_steps
        return tabular_task(tiger_pomdp(single), limit, SINGLE_THRESHOLD if single else THRESHOLD_PER_STEP * limit)

    def picture(self) -> Frame:
        """The moment as a picture, ``(540, 960, 3)``."""
        return tiger_drawing.picture(self.moment())

    def text(self) -> str:
        """The moment in a few lines of text."""
        return tiger_drawing.text(self.moment())


class TigerVector(VectorOf):
    """Many :class:`Tiger`."""

    scalar = Tiger
