"""Finite POMDPs as data: tables of probabilities and rewards, most of them zero.

A model has S states, A actions and Z observation symbols. The agent does not see the state but a symbol,
drawn on each arrival from a distribution that depends on the state arrived in and the action that led there;
what its policy receives is that symbol's row of ``features``. Distributions over symbols are kept in a pool,
for most models have few different ones, whatever the number of their states.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpsearch.pomdp.distributions import Distributions, by_row, row_starts


@dataclass(frozen=True, eq=False)
class TabularPOMDP:
    """A finite partially observable Markov decision process, sparse.

    Most models are built with :meth:`from_entries` or :meth:`from_dense`, or read from a file by
    :func:`dpsearch.pomdp.read_pomdp_file`.

    Attributes:
        start: Distribution of the start state: one row over S states.
        transitions: Row ``state * A + action`` is the distribution of the next state. An ended episode stays
            where it is: the rows of terminal states lead back to themselves.
        rewards: Reward of each entry of ``transitions``, ``(n_entries,)``; 0 in terminal states.
        observations: The pool of distributions over Z symbols.
        observation_row: Row of the pool for arriving in a state by an action, ``(S, A)``.
        first_observation_row: Row of the pool for a start state, before the first action, ``(S,)``.
        features: Input of the policy for each symbol, ``(Z, O)``.
        terminal: Whether the episode ends on arriving in a state, ``(S,)`` bool.
        discount: Factor by which rewards lose value from step to step, in [0, 1].
        state_names: Names of the states, or nothing.
        action_names: Names of the actions, or nothing.
        observation_names: Names of the symbols, or nothing.

    Raises:
        ValueError: If a table does not fit; the message names the first fault.
    """

    start: Distributions
    transitions: Distributions
    rewards: NDArray[np.float64]
    observations: Distributions
    observation_row: NDArray[np.int64]
    first_observation_row: NDArray[np.int64]
    features: NDArray[np.float64]
    terminal: NDArray[np.bool_]
    discount: float = 1.0
    state_names: tuple[str, ...] = ()
    action_names: tuple[str, ...] = ()
    observation_names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        states, actions = self.observation_row.shape
        if self.features.ndim != 2:
            raise ValueError(f"features must have shape (Z, O), got {self.features.shape}")
        symbols = len(self.features)
        _require_shape("terminal", self.terminal, (states,))
        _require_shape("rewards", self.rewards, self.transitions.columns.shape)
        _require_shape("first_observation_row", self.first_observation_row, (states,))
        if (self.start.n_rows, self.start.n_columns) != (1, states):
            raise ValueError(f"start must be one row over {states} states")
        if (self.transitions.n_rows, self.transitions.n_columns) != (states * actions, states):
            raise ValueError(f"transitions must have {states * actions} rows over {states} states")
        if self.observations.n_columns != symbols:
            raise ValueError(f"observations have {self.observations.n_columns} symbols, features {symbols}")
        self.start.check("start state", lambda row: "the model")
        self.transitions.check("next state", lambda row: f"state {row // actions}, action {row % actions}")
        self.observations.check("observation", self._first_use)
        for name in ("observation_row", "first_observation_row"):
            rows = getattr(self, name)
            if rows.min() < 0 or rows.max() >= self.observations.n_rows:
                raise ValueError(f"{name} must be in 0 .. {self.observations.n_rows - 1}")
        for name in ("rewards", "features"):
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} must be finite")
        if not 0 <= self.discount <= 1:
            raise ValueError(f"discount must be in [0, 1], got {self.discount}")
        if self.terminal[self.start.columns].any():
            raise ValueError("an episode cannot start in a terminal state")
        self._require_that_ended_episodes_stay()
        for name, names, count in (
            ("state_names", self.state_names, states),
            ("action_names", self.action_names, actions),
            ("observation_names", self.observation_names, symbols),
        ):
            if names and len(names) != count:
                raise ValueError(f"{name} must have {count} names or none, got {len(names)}")

    def _first_use(self, row: int) -> str:
        """A place where a row of the pool of observations is used, in words for error messages."""
        for state, action in np.argwhere(self.observation_row == row):
            return f"state {state}, action {action}"
        return f"state {np.argmax(self.first_observation_row == row)} at the start"

    def _require_that_ended_episodes_stay(self) -> None:
        origin = self.transitions.row_of_entry() // self.n_actions
        ended = self.terminal[origin]
        leaves = ended & ((self.transitions.columns != origin) | (self.rewards != 0))
        if leaves.any():
            state = origin[np.argmax(leaves)]
            raise ValueError(f"terminal state {state} must lead back to itself with reward 0")

    @classmethod
    def from_entries(
        cls,
        *,
        shape: tuple[int, int],
        start: ArrayLike,
        states: ArrayLike,
        actions: ArrayLike,
        next_states: ArrayLike,
        probabilities: ArrayLike = 1.0,
        rewards: ArrayLike = 0.0,
        terminal: ArrayLike = (),
        observations: Distributions,
        observation_row: ArrayLike,
        first_observation_row: ArrayLike,
        features: ArrayLike | None = None,
        discount: float = 1.0,
        state_names: tuple[str, ...] = (),
        action_names: tuple[str, ...] = (),
        observation_names: tuple[str, ...] = (),
    ) -> TabularPOMDP:
        """Builds a model from its possible transitions, in any order.

        A next state may be named twice for one state and action. If its rewards differ, the reward is random.

        Args:
            shape: ``(S, A)``, the number of states and of actions.
            start: Probability of each start state, ``(S,)``.
            states: State of each entry; this and the next four are broadcast against one another.
            actions: Action of each entry.
            next_states: Next state of each entry.
            probabilities: Probability of each entry.
            rewards: Reward of each entry.
            terminal: Indices of the states that end the episode. Entries that begin in them are ignored.
            observations: The pool of distributions over Z symbols.
            observation_row: Row of the pool for each state and action, broadcast to ``(S, A)``.
            first_observation_row: Row of the pool for each state at the start, broadcast to ``(S,)``.
            features: Input of the policy for each symbol, ``(Z, O)``; one-hot by default.
            discount: Factor by which rewards lose value from step to step, in [0, 1].
            state_names: Names of the states, or nothing.
            action_names: Names of the actions, or nothing.
            observation_names: Names of the symbols, or nothing.

        Raises:
            ValueError: If a table does not fit; the message names the first fault.
        """
        n_states, n_actions = shape
        ended = np.asarray(terminal, np.int64)
        _require_range("terminal", ended, n_states)
        over = np.zeros(n_states, np.bool_)
        over[ended] = True
        transitions, paid = _moves(shape, over, (states, actions, next_states), probabilities, rewards)
        return cls(
            start=Distributions.from_dense(start),
            transitions=transitions,
            rewards=paid,
            observations=observations,
            observation_row=_table(observation_row, (n_states, n_actions)),
            first_observation_row=_table(first_observation_row, (n_states,)),
            features=np.eye(observations.n_columns) if features is None else np.array(features, np.float64),
            terminal=over,
            discount=discount,
            state_names=state_names,
            action_names=action_names,
            observation_names=observation_names,
        )

    @classmethod
    def from_dense(
        cls,
        transitions: ArrayLike,
        observations: ArrayLike,
        rewards: ArrayLike,
        start: ArrayLike,
        *,
        first_observation: ArrayLike | None = None,
        features: ArrayLike | None = None,
        terminal: ArrayLike = (),
        discount: float = 1.0,
        state_names: tuple[str, ...] = (),
        action_names: tuple[str, ...] = (),
        observation_names: tuple[str, ...] = (),
    ) -> TabularPOMDP:
        """Builds a small model from full arrays.

        Args:
            transitions: Probability of each next state, ``(A, S, S)`` as ``[action, state, next state]``.
            observations: Probability of each symbol, ``(A, S, Z)`` as ``[action, next state, symbol]``.
            rewards: Reward ``[action, state, next state]``, broadcast to ``(A, S, S)``.
            start: Probability of each start state, ``(S,)``.
            first_observation: Probability of each symbol before the first action, broadcast to ``(S, Z)``. By
                default nothing is seen then: a symbol is added whose features are all zero.
            features: Input of the policy for each symbol, ``(Z, O)``; one-hot by default.
            terminal: Indices of the states that end the episode.
            discount: Factor by which rewards lose value from step to step, in [0, 1].
            state_names: Names of the states, or nothing.
            action_names: Names of the actions, or nothing.
            observation_names: Names of the symbols, or nothing.

        Raises:
            ValueError: If a table does not fit; the message names the first fault.
        """
        moves, seen = np.asarray(transitions, np.float64), np.asarray(observations, np.float64)
        if moves.ndim != 3 or moves.shape[1] != moves.shape[2]:
            raise ValueError(f"transitions must have shape (A, S, S), got {moves.shape}")
        n_actions, n_states, _ = moves.shape
        if seen.ndim != 3 or seen.shape[:2] != (n_actions, n_states):
            raise ValueError(f"observations must have shape ({n_actions}, {n_states}, Z), got {seen.shape}")
        n_symbols = seen.shape[2]
        values = np.eye(n_symbols) if features is None else np.asarray(features, np.float64)
        if first_observation is None:
            seen, values, first = _with_nothing_seen_first(seen, values)
            observation_names = (*observation_names, "nothing") if observation_names else ()
        else:
            first = np.broadcast_to(np.asarray(first_observation, np.float64), (n_states, n_symbols))
        by_arrival = seen.transpose(1, 0, 2).reshape(n_states * n_actions, -1)  # row = next state * A + action
        pool, row = np.unique(np.concatenate([by_arrival, first]), axis=0, return_inverse=True)
        action, state, following = np.nonzero(moves)
        return cls.from_entries(
            shape=(n_states, n_actions),
            start=start,
            states=state,
            actions=action,
            next_states=following,
            probabilities=moves[action, state, following],
            rewards=np.broadcast_to(rewards, moves.shape)[action, state, following],
            terminal=terminal,
            observations=Distributions.from_dense(pool),
            observation_row=row[: n_states * n_actions].reshape(n_states, n_actions),
            first_observation_row=row[n_states * n_actions :],
            features=values,
            discount=discount,
            state_names=state_names,
            action_names=action_names,
            observation_names=observation_names,
        )

    @property
    def n_states(self) -> int:
        """S, the number of states, terminal ones included."""
        return len(self.terminal)

    @property
    def n_actions(self) -> int:
        """A, the number of actions."""
        return int(self.observation_row.shape[1])

    @property
    def n_symbols(self) -> int:
        """Z, the number of observation symbols."""
        return len(self.features)

    def start_distribution(self) -> NDArray[np.float64]:
        """Probability of each start state, ``(S,)``."""
        return self.start.dense().reshape(-1)

    def transition_matrix(self, action: int) -> NDArray[np.float64]:
        """Probability of each next state, ``(S, S)`` as ``[state, next state]``, for small models."""
        matrix = np.zeros((self.n_states, self.n_states))
        row, chosen = self._entries_of(action)
        np.add.at(matrix, (row, self.transitions.columns[chosen]), self.transitions.probabilities[chosen])
        return matrix

    def observation_matrix(self, action: int) -> NDArray[np.float64]:
        """Probability of each symbol on arriving in each state by an action, ``(S, Z)``, for small models."""
        return self.observations.dense()[self.observation_row[:, action]]

    def first_observation_matrix(self) -> NDArray[np.float64]:
        """Probability of each symbol before the first action, ``(S, Z)``, for small models."""
        return self.observations.dense()[self.first_observation_row]

    def expected_rewards(self) -> NDArray[np.float64]:
        """Mean reward of each action in each state, ``(S, A)``."""
        weighted = self.transitions.probabilities * self.rewards
        sums = np.add.reduceat(weighted, self.transitions.starts[:-1])
        return sums.reshape(self.n_states, self.n_actions)

    def _entries_of(self, action: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        row = self.transitions.row_of_entry()
        chosen = np.flatnonzero(row % self.n_actions == action)
        return row[chosen] // self.n_actions, chosen


def _moves(
    shape: tuple[int, int],
    over: NDArray[np.bool_],
    entries: tuple[ArrayLike, ArrayLike, ArrayLike],
    probabilities: ArrayLike,
    rewards: ArrayLike,
) -> tuple[Distributions, NDArray[np.float64]]:
    """Transitions with the reward of each entry; states that are ``over (S,)`` stay where they are."""
    n_states, n_actions = shape
    numbers = (np.asarray(array, np.int64) for array in entries)
    state, action, following, probability, reward = (
        array.ravel() for array in np.broadcast_arrays(*numbers, probabilities, rewards)
    )
    _require_range("states", state, n_states)
    _require_range("actions", action, n_actions)
    keep = ~over[state]
    ends = np.repeat(np.flatnonzero(over), n_actions)
    row = np.concatenate([(state * n_actions + action)[keep], ends * n_actions + np.arange(len(ends)) % n_actions])
    probability = np.append(probability[keep], np.ones(len(ends)))
    order = by_row(row, probability)
    transitions = Distributions(
        row_starts(row[order], n_states * n_actions),
        np.append(following[keep], ends)[order],
        probability[order].astype(np.float64),
        n_states,
    )
    return transitions, np.append(reward[keep], np.zeros(len(ends)))[order].astype(np.float64)


def _with_nothing_seen_first(
    seen: NDArray[np.float64], features: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Observations ``(A, S, Z + 1)`` and features with one symbol more, and first observations that are that one."""
    _, n_states, n_symbols = seen.shape
    first = np.eye(n_symbols + 1)[[n_symbols] * n_states]
    features = np.append(features, np.zeros((1, *features.shape[1:])), axis=0)
    return np.pad(seen, ((0, 0), (0, 0), (0, 1))), features, first


def _require_shape(name: str, array: NDArray[np.generic], shape: tuple[int, ...]) -> None:
    if array.shape != shape:
        raise ValueError(f"{name} must have shape {shape}, got {array.shape}")


def _require_range(name: str, indices: NDArray[np.int64], count: int) -> None:
    if indices.size and (indices.min() < 0 or indices.max() >= count):
        raise ValueError(f"{name} must be in 0 .. {count - 1}, got {indices.min()} .. {indices.max()}")


def _table(values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.int64]:
    return np.array(np.broadcast_to(np.asarray(values, np.int64), shape))
