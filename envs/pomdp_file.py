"""Any finite POMDP, from a file in Cassandra's .POMDP format.

::

    discount: 0.75
    values: reward
    states: tiger-left tiger-right
    actions: listen open-left open-right
    observations: hear-left hear-right

    T : listen identity
    T : open-left uniform
    ...

- *Start, actions, rewards:* as the file says. What is seen before the first action, it cannot say: nothing.
- *Observations:* one input for each of the file's observations, 1 for the one that is seen and 0 for the others; all
  are 0 at the start.
- *End:* in states that every action leads back to without reward, and that are no start states; or after 100 steps.

``dpsearch/pomdp/file_format/`` has the details in ``reader.py``, and in ``comments.py`` the comments by which a file
can say more.

Source: A. R. Cassandra, "POMDP file format", pomdp.org.
"""

from __future__ import annotations

import math
import os

from dpsearch.env_kit.vector_env import VectorOf
from dpsearch.pomdp.cards import likely, status
from dpsearch.pomdp.env import Moment, TabularEnv
from dpsearch.pomdp.file_format.reader import read_pomdp_file
from dpsearch.pomdp.task import TabularTask, tabular_task

SHORTEST, LONGEST = 100, 10_000
FADED = 0.01  # an episode lasts until rewards count for less than this, by discount


class POMDP(TabularEnv):
    """One finite POMDP from a file.

    Args:
        path: Path of the file.
        max_episode_steps: Steps after which an episode is cut off; by default as many as it takes until a reward counts
            for 1% by the file's discount factor, at least 100 and at most 10,000.
        render_mode: "ansi" (text) or None.
        reveal: Secrets that the text shows: "state", "belief" or "nothing"; see :class:`TabularEnv`.

    Attributes:
        path: Path of the file.

    Raises:
        ValueError: If an argument is not accepted, or the file cannot be read: a ``PomdpFileError`` that names the
            line.
    """

    metadata = {"render_modes": ["ansi"], "render_fps": 4}

    def __init__(
        self,
        path: str | os.PathLike[str],
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        reveal: str = "state",
    ) -> None:
        super().__init__(self.make_task(path, max_episode_steps), render_mode, reveal)
        self.path = path

    @classmethod
    def make_task(cls, path: str | os.PathLike[str], max_episode_steps: int | None = None) -> TabularTask:
        """The task that the class plays with these arguments."""
        model = read_pomdp_file(path)
        return tabular_task(model, default_limit(model.discount) if max_episode_steps is None else max_episode_steps)

    def text(self) -> str:
        """The moment in up to three lines of text."""
        return text(self.moment())


def default_limit(discount: float) -> int:
    """Steps until a reward counts for 1%, at least 100 and at most 10,000: 4,603 for a discount factor of 0.999."""
    if discount <= 0.0 or discount >= 1.0:
        return SHORTEST if discount <= 0.0 else LONGEST
    return min(max(math.ceil(math.log(FADED) / math.log(discount)), SHORTEST), LONGEST)


class POMDPVector(VectorOf):
    """Many :class:`POMDP`."""

    scalar = POMDP


def text(moment: Moment) -> str:
    """The moment in up to three lines: where the agent is, what it sees and did, and what it could infer."""
    names = moment.pomdp.state_names or [str(state) for state in range(moment.pomdp.n_states)]
    lines = [f" {status(moment)}"]
    if moment.state_shown:
        reward = "none yet" if moment.last_reward is None else f"{moment.last_reward:g}"
        end = ", which ends the episode" if moment.terminated else ""
        lines.insert(0, f" state {names[moment.state]}{end}, last reward {reward}")
    if moment.belief is not None:
        lines.append(f" belief: {likely(names, moment.belief)}")
    return "\n".join(lines)
