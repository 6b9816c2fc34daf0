"""Rewards that depend on the observation, by telling states apart by what is seen in them.

A table of rewards knows state, action and next state, not what is seen there. Where a .POMDP file pays for the
observation too, the next state is split: the agent arrives with probability ``p O(o)`` in a copy of it in which ``o``
is certain to be seen, and earns the reward of ``o``. A copy is left as the state itself is. So rewards and
observations have the joint distribution that the file says. Where all observations that may be seen pay equally, the
agent arrives in the state itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpsearch.pomdp.distributions import Distributions, expanded, row_starts
from dpsearch.pomdp.file_format.pool import certain, joined, rows_of
from dpsearch.pomdp.file_format.preamble import MOST_ROWS
from dpsearch.pomdp.file_format.tables import MOST_ENTRIES, RewardTable


@dataclass(frozen=True)
class Moves:
    """Transitions with their rewards; rows ``state * A + action``.

    Attributes:
        transitions: Distribution of the next state.
        rewards: Reward of each entry, ``(n_entries,)``.
        copy_of: The state that each further state is a copy of, ``(K,)``; copies are numbered from S on.
        sees: Observation seen in each copy, ``(K,)``.
    """

    transitions: Distributions
    rewards: NDArray[np.float64]
    copy_of: NDArray[np.int64]
    sees: NDArray[np.int64]


def rewarded(transitions: Distributions, seen: Distributions, table: RewardTable, n_actions: int) -> Moves:
    """Transitions with their rewards, to copies of states where the rewards depend on the observation.

    The copies have no rows of their own yet; see :func:`with_copies`.

    Args:
        transitions: Row ``state * A + action``: distribution of the next state.
        seen: Row ``next state * A + action``: distribution of the observation.
        table: Rewards, by action, states and observation.
        n_actions: A.

    Raises:
        ValueError: If the model would become too large.
    """
    n_states, n_symbols = transitions.n_columns, seen.n_columns
    row, column = transitions.row_of_entry(), transitions.columns
    state, action = np.divmod(row, n_actions)
    rewards = table.at(action, state, column, np.zeros(1, np.int64))

    unsure = np.flatnonzero(table.may_depend_on_observation(action, state, column))
    seen_row = column[unsure] * n_actions + action[unsure]
    lengths = np.diff(seen.starts)[seen_row]
    if lengths.sum() > MOST_ENTRIES:
        raise ValueError(f"rewards depend on the observation in {lengths.sum():,} cases: the limit is {MOST_ENTRIES:,}")
    entry, which = expanded(seen.starts[seen_row], lengths)
    origin, symbol = unsure[which], seen.columns[entry]
    paid = table.at(action[origin], state[origin], column[origin], symbol)
    first = np.cumsum(lengths) - lengths
    if len(unsure):
        low, high = np.minimum.reduceat(paid, first), np.maximum.reduceat(paid, first)
        total = np.add.reduceat(seen.probabilities[entry], first)
    else:
        low = high = total = np.zeros(0)
    rewards[unsure] = low
    differs = (low != high)[which]
    origin, symbol, paid = origin[differs], symbol[differs], paid[differs]
    share = (seen.probabilities[entry] / total[which])[differs]

    pairs, copy = np.unique(column[origin] * n_symbols + symbol, return_inverse=True)
    if (n_states + len(pairs)) * n_actions > MOST_ROWS:
        raise ValueError(
            f"rewards depend on the observation: to tell {len(pairs):,} pairs of state and observation apart "
            f"takes as many more states, the limit is {MOST_ROWS // n_actions:,}"
        )
    whole = np.setdiff1d(np.arange(len(row)), origin)
    order = np.argsort(np.append(whole, origin), kind="stable")
    return Moves(
        Distributions(
            row_starts(row[np.append(whole, origin)[order]], transitions.n_rows),
            np.append(column[whole], n_states + copy)[order],
            np.append(transitions.probabilities[whole], transitions.probabilities[origin] * share)[order],
            n_states + len(pairs),
        ),
        np.append(rewards[whole], paid)[order],
        pairs // n_symbols,
        pairs % n_symbols,
    )


def with_copies(moves: Moves, terminal: NDArray[np.bool_]) -> Moves:
    """Adds the rows of the copies: a copy moves as its state does; a copy of a terminal state stays where it is.

    Args:
        moves: Transitions from the states that are no copies.
        terminal: Which of these states end the episode, ``(S,)``.

    Raises:
        ValueError: If the model would become too large.
    """
    n_states, n_actions = len(terminal), moves.transitions.n_rows // len(terminal)
    rows = (moves.copy_of[:, None] * n_actions + np.arange(n_actions)).ravel()
    lengths = np.diff(moves.transitions.starts)[rows]
    if lengths.sum() > MOST_ENTRIES:
        raise ValueError(
            f"rewards depend on the observation: to tell {len(moves.copy_of):,} pairs of state and observation apart "
            f"takes {lengths.sum():,} more transitions, the limit is {MOST_ENTRIES:,}"
        )
    entry, which = expanded(moves.transitions.starts[rows], lengths)
    copies = rows_of(moves.transitions, rows)
    number = which // n_actions
    ended = terminal[moves.copy_of[number]]
    copies.columns[ended] = n_states + number[ended]
    return Moves(
        joined(moves.transitions, copies), np.append(moves.rewards, moves.rewards[entry]), moves.copy_of, moves.sees
    )


def with_certain_rows(seen: Distributions, sees: NDArray[np.int64], n_actions: int) -> Distributions:
    """The observations ``next state * A + action`` with the rows of the copies, which are certain."""
    return joined(seen, certain(np.repeat(sees, n_actions), seen.n_columns))
