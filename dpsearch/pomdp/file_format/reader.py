"""Reads Cassandra's format for finite POMDPs, as described on pomdp.org ("POMDP file format"), into sparse tables.

It reads all forms of T, O and R, wildcards, ``uniform``, ``identity``, ``reset``, all forms of ``start``, and
``values: cost``; statements may be in any order, and where two contradict each other, the later one holds. Names may
hold more characters than the original allows. How the format becomes a :class:`TabularPOMDP`:

- It has no observation before the first action: nothing is seen then, a symbol of its own whose features are zero.
- It has no terminal states: a state is taken for one if every action leads back to it without reward and an episode
  cannot start there. So there are none where a file gives no ``start``: every state is a start state then.
- It may pay for what is observed: see ``split.py``, which adds states called ``state/observation``.
- Costs are negative rewards.
- Probabilities of few digits, which sum to 1 within 1e-5 only, are made to do so exactly.

Comments say whatever else a model has; see ``comments.py``.
"""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from dpsearch.pomdp.distributions import Distributions, by_row, row_starts
from dpsearch.pomdp.file_format.comments import NAME_KEYS, POOL_KEYS, Comments
from dpsearch.pomdp.file_format.pool import certain, disagreement, joined, rows_of, shared, unseen_name
from dpsearch.pomdp.file_format.preamble import MOST_INPUTS, Outline
from dpsearch.pomdp.file_format.split import Moves, rewarded, with_certain_rows, with_copies
from dpsearch.pomdp.file_format.statements import Settings, Statements, parse
from dpsearch.pomdp.file_format.tables import RewardTable, Table
from dpsearch.pomdp.file_format.tokens import Names, PomdpFileError, Source
from dpsearch.pomdp.model import TabularPOMDP


def read_pomdp_file(path: str | os.PathLike[str]) -> TabularPOMDP:
    """The model in a .POMDP file.

    Raises:
        PomdpFileError: If there is no such file, or it does not hold a model in the format. The message names the
            line.
    """
    source = Source.read(path)
    statements, comments = parse(source), Comments(source)
    try:
        return _Model(source, statements, comments).pomdp()
    except PomdpFileError:
        raise
    except ValueError as error:  # TabularPOMDP refuses comments that contradict one another
        raise source.error(str(error)) from error


def read_discount(path: str | os.PathLike[str]) -> float:
    """The discount factor in a .POMDP file.

    Raises:
        PomdpFileError: If there is no such file, or it says none.
    """
    return Outline(Source.read(path)).discount()


class _Model:
    """The model that the statements and comments of a file define."""

    def __init__(self, source: Source, statements: Statements, comments: Comments) -> None:
        self.source, self.statements, self.comments = source, statements, comments
        self.preamble = statements.preamble
        self.states, self.actions = self.preamble.states, self.preamble.actions
        self.symbols = self.preamble.observations

    def pomdp(self) -> TabularPOMDP:
        statements, preamble, comments = self.statements, self.preamble, self.comments
        states, symbols, n_actions = self.states, self.symbols, self.actions.count
        if symbols.count > MOST_INPUTS and "features" not in comments:
            raise self.source.error(
                f"{symbols.count:,} observations would be as many inputs: the limit is {MOST_INPUTS:,}"
            )
        start = self._start()
        transitions = self._table("T", statements.transitions, states)
        seen = _by_column(self._table("O", statements.observations, symbols))
        table = RewardTable(statements.rewards, (n_actions, states.count, states.count, symbols.count))
        moves = rewarded(transitions, seen, table, n_actions)
        if preamble.cost:
            moves = Moves(moves.transitions, 0.0 - moves.rewards, moves.copy_of, moves.sees)
        if len(moves.copy_of):
            self._require_no_numbers_of_states()
        elif "transitions" in comments:
            moves = self._with_random_rewards(moves)
        terminal = self._terminal(moves, start)
        names = self._names()
        pool, row, first_row, features, observation_names = self._observations(seen, moves.sees, names[2])
        moves = with_copies(moves, terminal)
        return TabularPOMDP(
            start=Distributions(start.starts, start.columns, start.probabilities, moves.transitions.n_columns),
            transitions=moves.transitions,
            rewards=moves.rewards,
            observations=pool,
            observation_row=row,
            first_observation_row=first_row,
            features=features,
            terminal=np.append(terminal, terminal[moves.copy_of]),
            discount=preamble.discount,
            state_names=self._names_with_copies(names[0], names[2], moves),
            action_names=names[1],
            observation_names=observation_names,
        )

    def _table(self, keyword: str, settings: Settings, columns: Names) -> Distributions:
        table = Table(self.source, keyword, settings, self.actions, self.states, columns)
        return table.distributions(self.preamble.start)

    def _start(self) -> Distributions:
        start = Distributions.from_dense(self.preamble.start)
        if "start" not in self.comments:
            return start
        pairs = self.comments.floats("start")
        if pairs.ndim != 2 or pairs.shape[1] != 2:
            raise self.comments.error("start", "must list pairs [state, probability]")
        given = self._rows("start", [pairs], start.n_columns)
        if disagreement(given, start) is not None:
            raise self.comments.error("start", "contradicts start:")
        return given

    def _rows(self, key: str, rows: list[NDArray[np.float64]], n_columns: int) -> Distributions:
        """The rows in a comment, each ``(n, 2)``: column and probability."""
        entries = np.concatenate([np.zeros((0, 2)), *rows])
        columns = entries[:, 0]
        if (columns != np.floor(columns)).any() or (columns < 0).any() or (columns >= n_columns).any():
            raise self.comments.error(key, f"must number what has a probability from 0 to {n_columns - 1}")
        if not (entries[:, 1] > 0).all():
            raise self.comments.error(key, "must list probabilities above 0")
        starts = np.append(0, np.cumsum([len(row) for row in rows])).astype(np.int64)
        return Distributions(starts, columns.astype(np.int64), entries[:, 1].copy(), n_columns)

    def _with_random_rewards(self, moves: Moves) -> Moves:
        """The transitions and rewards, with the rows from comments that name a next state several times."""
        n_states, n_actions = self.states.count, self.actions.count
        wrong = self.comments.error(
            "transitions", "must list [state, action, [[next state, probability, reward], ...]]"
        )
        given_rows: dict[int, NDArray[np.float64]] = {}
        for item in self.comments.items("transitions"):
            if not isinstance(item, list) or len(item) != 3:
                raise wrong
            place, table = (self.comments.array("transitions", part) for part in (item[:2], item[2]))
            if place.shape != (2,) or table.ndim != 2 or table.shape[1] != 3:
                raise wrong
            if place[0] not in range(n_states) or place[1] not in range(n_actions):
                raise self.comments.error("transitions", "names a state or action that does not exist")
            row = int(place[0]) * n_actions + int(place[1])
            if row in given_rows:
                raise self.comments.error("transitions", "names a state and action twice")
            given_rows[row] = table
        rows = sorted(given_rows)
        chosen = np.array(rows, np.int64)
        new = self._rows("transitions", [given_rows[row][:, :2] for row in rows], n_states)
        paid = np.concatenate([np.zeros(0), *(given_rows[row][:, 2] for row in rows)])
        old = rows_of(moves.transitions, chosen)
        paid_before = moves.rewards[np.isin(moves.transitions.row_of_entry(), chosen)]
        mean, mean_before = (
            Distributions(table.starts, table.columns, table.probabilities * rewards, n_states)
            for table, rewards in ((new, paid), (old, paid_before))
        )
        for one, other, what in ((new, old, "T"), (mean, mean_before, "R")):
            bad = disagreement(one, other)
            if bad is not None:
                state, action = divmod(rows[bad], n_actions)
                raise self.comments.error("transitions", f"contradicts {what} for state {state}, action {action}")
        return _replaced(moves, chosen, new, paid)

    def _require_no_numbers_of_states(self) -> None:
        """Makes sure that no comment numbers states where rewards for observations add states."""
        for key in ("transitions", *POOL_KEYS):
            if key in self.comments:
                raise self.comments.error(key, "cannot be used where rewards depend on the observation")

    def _terminal(self, moves: Moves, start: Distributions) -> NDArray[np.bool_]:
        terminal = np.zeros(self.states.count, np.bool_)
        if "terminal" in self.comments:
            terminal[self.comments.indices("terminal", self.states.count)] = True
            return terminal
        origin = moves.transitions.row_of_entry() // self.actions.count
        terminal[:] = True
        terminal[origin[(moves.transitions.columns != origin) | (moves.rewards != 0)]] = False
        terminal[start.columns] = False
        return terminal

    def _names(self) -> list[tuple[str, ...]]:
        """Names of the states, actions and symbols: the file's words, or the names in its comments."""
        return [
            self.comments.words(key, names.count) if key in self.comments else names.names
            for key, names in zip(NAME_KEYS, (self.states, self.actions, self.symbols), strict=True)
        ]

    def _names_with_copies(self, states: tuple[str, ...], symbols: tuple[str, ...], moves: Moves) -> tuple[str, ...]:
        if not len(moves.copy_of):
            return states
        states = states or tuple(map(str, range(self.states.count)))
        symbols = symbols or tuple(map(str, range(self.symbols.count)))
        pairs = zip(moves.copy_of.tolist(), moves.sees.tolist(), strict=True)
        return (*states, *(f"{states[state]}/{symbols[symbol]}" for state, symbol in pairs))

    def _observations(
        self, seen: Distributions, sees: NDArray[np.int64], names: tuple[str, ...]
    ) -> tuple[Distributions, NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], tuple[str, ...]]:
        """The pool, its rows on arrival and at the start, the features, and the symbols' names."""
        n_states, n_actions, n_symbols = self.states.count, self.actions.count, self.symbols.count
        if POOL_KEYS[0] in self.comments:
            pool, row, first = self._pool(seen)
            return pool, row, first, self._features(n_symbols), names
        nothing = certain(np.array([n_symbols]), n_symbols + 1)
        pool, which = shared(joined(with_certain_rows(seen, sees, n_actions), nothing))
        row = which[:-1].reshape(-1, n_actions)
        first = np.full(n_states + len(sees), which[-1])
        names = (*names, unseen_name(names)) if names else ()
        return pool, row, first, self._features(n_symbols + 1), names

    def _features(self, count: int) -> NDArray[np.float64]:
        """The policy's input for each of ``count`` symbols: one number for each symbol in the file."""
        if "features" not in self.comments:
            return np.eye(count, self.symbols.count)
        features = self.comments.floats("features")
        if features.ndim != 2 or len(features) != count or not features.size:
            raise self.comments.error("features", f"must list {count} rows of numbers")
        return features

    def _pool(self, seen: Distributions) -> tuple[Distributions, NDArray[np.int64], NDArray[np.int64]]:
        """The pool and its rows on arrival and at the start, from comments."""
        comments, n_states, n_actions = self.comments, self.states.count, self.actions.count
        pool_key, row_key, first_key = POOL_KEYS
        rows = [comments.array(pool_key, row) for row in comments.items(pool_key)]
        if not rows or any(row.ndim != 2 or row.shape[1] != 2 for row in rows):
            raise comments.error(pool_key, "must list rows of pairs [symbol, probability]")
        pool = self._rows(pool_key, rows, self.symbols.count)
        row, first = comments.indices(row_key, pool.n_rows), comments.indices(first_key, pool.n_rows)
        if row.shape not in ((n_states,), (n_states, n_actions)):
            raise comments.error(row_key, f"must list {n_states} numbers, or as many rows of {n_actions}")
        if first.shape != (n_states,):
            raise comments.error(first_key, f"must list {n_states} numbers")
        row = np.array(np.broadcast_to(row.reshape(n_states, -1), (n_states, n_actions)))
        bad = disagreement(rows_of(pool, row.ravel()), seen)
        if bad is not None:
            raise comments.error(row_key, f"contradicts O for state {bad // n_actions}, action {bad % n_actions}")
        return pool, row, first


def _by_column(table: Distributions) -> Distributions:
    order = np.lexsort((table.columns, table.row_of_entry()))
    return Distributions(table.starts, table.columns[order], table.probabilities[order], table.n_columns)


def _replaced(moves: Moves, rows: NDArray[np.int64], given: Distributions, paid: NDArray[np.float64]) -> Moves:
    """The transitions and rewards with some rows replaced."""
    old = moves.transitions
    kept = ~np.isin(old.row_of_entry(), rows)
    row = np.append(old.row_of_entry()[kept], rows[given.row_of_entry()])
    probabilities = np.append(old.probabilities[kept], given.probabilities)
    order = by_row(row, probabilities)
    transitions = Distributions(
        row_starts(row[order], old.n_rows),
        np.append(old.columns[kept], given.columns)[order],
        probabilities[order],
        old.n_columns,
    )
    return Moves(transitions, np.append(moves.rewards[kept], paid)[order], moves.copy_of, moves.sees)
