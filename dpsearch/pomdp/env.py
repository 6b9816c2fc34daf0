"""A finite POMDP as a scalar Gymnasium environment, and the moment that its drawings show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from dpsearch.env_kit.env import KernelEnv
from dpsearch.pomdp.belief import BeliefFilter
from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.task import TabularTask

REVEALED = ("state", "belief", "nothing")
"""Contents of drawings besides the observation: the hidden state; the state and the exact belief; or nothing."""
MOST_BELIEVED = 5000
"""States of the largest model for which beliefs can be shown: the tables for Bayes' rule grow with their square."""


@dataclass(frozen=True)
class Moment:
    """The present moment of a finite POMDP, as drawings need it.

    Attributes:
        pomdp: The model.
        state: The hidden state.
        symbol: The observation symbol.
        reveal: Which of ``REVEALED`` the spectator is shown.
        belief: Probability of each state given all observations and actions, ``(S,)``; None unless revealed.
        last_state: The hidden state before the last action; None at the start of an episode.
        last_action: The last action; None at the start of an episode.
        last_reward: The last reward; None at the start of an episode.
        step: Steps so far.
        max_steps: Steps at which the episode is cut off.
        episode_return: Sum of rewards so far.
    """

    pomdp: TabularPOMDP
    state: int
    symbol: int
    reveal: str
    belief: NDArray[np.float64] | None
    last_state: int | None
    last_action: int | None
    last_reward: float | None
    step: int
    max_steps: int
    episode_return: float

    @property
    def state_shown(self) -> bool:
        """Whether the spectator may see the hidden state."""
        return self.reveal != "nothing"

    @property
    def terminated(self) -> bool:
        """Whether the episode has come to its own end."""
        return bool(self.pomdp.terminal[self.state])

    @property
    def inputs(self) -> tuple[float, ...]:
        """The features of the present symbol, which the agent receives."""
        return tuple(self.pomdp.features[self.symbol].tolist())

    @property
    def sees(self) -> str:
        """Name of the present symbol."""
        return _name(self.pomdp.observation_names, self.symbol)

    @property
    def did(self) -> str:
        """Name of the last action."""
        return "none yet" if self.last_action is None else _name(self.pomdp.action_names, self.last_action)


class TabularEnv(KernelEnv):
    """A finite POMDP as an environment.

    Args:
        task: The task to play.
        render_mode: One of ``metadata["render_modes"]``, or None.
        reveal: Secrets that drawings show: "state", the hidden state; "belief", the exact belief as well; or "nothing".

    Attributes:
        pomdp: The model.
        reveal: Secrets that drawings show: "state", "belief" or "nothing".

    Raises:
        ValueError: If an argument is not accepted.
    """

    metadata = {"render_modes": ["rgb_array", "human", "ansi"], "render_fps": 4}

    def __init__(self, task: TabularTask, render_mode: str | None = None, reveal: str = "state") -> None:
        if reveal not in REVEALED:
            raise ValueError(f"reveal must be one of {', '.join(REVEALED)}, got {reveal!r}")
        if reveal == "belief" and task.pomdp.n_states > MOST_BELIEVED:
            raise ValueError(
                f'reveal="belief" is for models of up to {MOST_BELIEVED:,} states, this one has {task.pomdp.n_states:,}'
            )
        super().__init__(task, render_mode)
        self.pomdp = task.pomdp
        self.reveal = reveal
        self._state: int | None = None  # the present state, and the one before
        self._last_state: int | None = None
        drawn = render_mode is not None and reveal == "belief"
        self._filter = BeliefFilter(task.pomdp) if drawn else None
        self._belief: NDArray[np.float64] | None = None

    @override
    def _follow(self) -> None:
        if self.render_mode is None:
            return
        state, symbol = (int(value) for value in self.kernel_state())
        self._last_state, self._state = None if self.last_action is None else self._state, state
        if self._filter is None:
            return
        if self._belief is None or self.last_action is None:
            self._belief = self._filter.start([symbol])
            return
        ended = [self.pomdp.terminal[state]]  # the agent knows when its episode ends
        self._belief = self._filter.update(self._belief, [int(self.last_action)], [symbol], ended)

    def moment(self) -> Moment:
        """The present moment, for drawings; the environment must have a render mode."""
        state, symbol = (int(value) for value in self.kernel_state())
        return Moment(
            pomdp=self.pomdp,
            state=state,
            symbol=symbol,
            reveal=self.reveal,
            belief=None if self._belief is None else self._belief[0],
            last_state=self._last_state,
            last_action=None if self.last_action is None else int(self.last_action),
            last_reward=self.last_reward,
            step=self.elapsed_steps,
            max_steps=self.max_episode_steps,
            episode_return=self.episode_return,
        )


def _name(names: tuple[str, ...], number: int) -> str:
    return names[number] if names else str(number)
