"""Sparse tables from the statements of a .POMDP file; the full tables are never built.

A later statement holds where it contradicts an earlier one. So the last statement about a whole row of T or O sets
the row, and the single probabilities that were given after it change the row.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dpsearch.pomdp.distributions import Distributions, expanded, row_starts
from dpsearch.pomdp.file_format.preamble import EXACT, ROUNDING
from dpsearch.pomdp.file_format.statements import Form, RewardSettings, Settings
from dpsearch.pomdp.file_format.tokens import ALL, Names, PomdpFileError, Source

MOST_ENTRIES = 10_000_000
"""Limit of the number of probabilities above 0 that a table may hold."""


class Table:
    """The table T or O, with a distribution in row ``state * A + action``.

    Args:
        source: The words of the file.
        keyword: "T" or "O".
        settings: The statements about this table.
        actions: Names of the actions.
        states: Names of the states.
        columns: Names of the columns: next states or observations.
    """

    def __init__(
        self, source: Source, keyword: str, settings: Settings, actions: Names, states: Names, columns: Names
    ) -> None:
        self.source, self.keyword, self.settings = source, keyword, settings
        self.actions, self.states, self.columns = actions, states, columns

    def distributions(self, start: NDArray[np.float64]) -> Distributions:
        """The rows as distributions. Entries of a row keep the order of the file; those of a matrix are by column.

        Args:
            start: Distribution of the start state, the meaning of the word ``reset``, ``(S,)``.

        Raises:
            PomdpFileError: If a row is missing or does not sum to 1, or the rows together are too large.
        """
        n_rows, n_columns = self.states.count * self.actions.count, self.columns.count
        base = self._bases()
        pieces = [self._entries_of_bases(base, start), self._entries_of_cells(base)]
        row, column, probability, statement = (
            np.concatenate([piece[part] for piece in pieces])
            for part in range(4)  # rows, columns, probabilities, statements
        )
        if len(pieces[1][0]):
            cell = row * n_columns + column
            order = np.lexsort((statement, cell))
            last = np.append(cell[order][1:] != cell[order][:-1], True)
            kept = order[last]
            kept = kept[probability[kept] != 0]
            kept = kept[np.lexsort((column[kept], statement[kept], row[kept]))]
            row, column, probability = row[kept], column[kept], probability[kept]
        starts = row_starts(row, n_rows)
        lengths = np.diff(starts)
        if not lengths.all():
            raise self._bad_row(int(np.argmin(lengths)), None)
        sums = np.add.reduceat(probability, starts[:-1])
        wrong = np.abs(sums - 1) > ROUNDING
        if wrong.any():
            bad = int(np.argmax(wrong))
            raise self._bad_row(bad, float(sums[bad]))
        rounded = (np.abs(sums - 1) > EXACT)[row]
        probability[rounded] /= sums[row[rounded]]
        return Distributions(starts, column, probability, n_columns)

    def _bases(self) -> NDArray[np.int64]:
        """The last statement that sets each row as a whole, or -1, ``(n_rows,)``."""
        action, state = self.settings.action, self.settings.state
        whole = (self.settings.form != Form.CELL) | (self.settings.column == ALL)
        base = np.full((self.states.count, self.actions.count), -1)
        everywhere = np.flatnonzero(whole & (action == ALL) & (state == ALL))
        first = int(everywhere[-1]) if len(everywhere) else 0  # earlier statements about the row do not matter
        chosen = first + np.flatnonzero(whole[first:])
        every = slice(None)
        for i, a, s in zip(chosen.tolist(), action[chosen].tolist(), state[chosen].tolist(), strict=True):
            base[every if s == ALL else s, every if a == ALL else a] = i
        return base.ravel()

    def _entries_of_bases(
        self, base: NDArray[np.int64], start: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
        """Row, column, probability and statement of each positive entry in rows that were set as a whole."""
        settings, n_columns = self.settings, self.columns.count
        row = np.flatnonzero(base >= 0)
        statement = base[row]
        form = settings.form[statement]
        state = row // self.actions.count

        # All numbers that a row can have, one such row behind the other, and where each row finds its own
        blocks = [settings.values, np.full(n_columns, 1 / n_columns), start]
        offset = settings.first[statement] + np.where(form == Form.MATRIX, state * n_columns, 0)
        offset[form == Form.UNIFORM] = len(settings.values)
        offset[form == Form.RESET] = len(settings.values) + n_columns
        same = form == Form.CELL  # T : a : s : * p
        constants, which = np.unique(settings.values[settings.first[statement[same]]], return_inverse=True)
        if constants.size * n_columns > MOST_ENTRIES:
            raise self._too_large(constants.size * n_columns)
        offset[same] = sum(map(len, blocks)) + which * n_columns
        blocks.append(np.repeat(constants, n_columns))
        values = np.concatenate(blocks)

        there = np.flatnonzero(values)
        first, end = np.searchsorted(there, offset), np.searchsorted(there, offset + n_columns)
        identity = form == Form.IDENTITY
        entry, source_row = self._expanded(np.where(identity, 0, first), np.where(identity, 1, end - first))
        index = there[entry]
        column = np.where(identity[source_row], state[source_row], index - offset[source_row])
        probability = np.where(identity[source_row], 1.0, values[index])
        return row[source_row], column, probability, statement[source_row]

    def _entries_of_cells(
        self, base: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
        """Row, column, probability and statement of each single probability that was given later; it may be zero."""
        settings, n_actions, n_states = self.settings, self.actions.count, self.states.count
        cells = np.flatnonzero((settings.form == Form.CELL) & (settings.column != ALL))
        cells = cells[cells > base.min()]
        every_action, every_state = settings.action[cells] == ALL, settings.state[cells] == ALL
        count = np.where(every_action, n_actions, 1) * np.where(every_state, n_states, 1)
        within, source = self._expanded(np.zeros_like(count), count)
        statement = cells[source]
        action = np.where(every_action[source], within % n_actions, settings.action[statement])
        rest = np.where(every_action[source], within // n_actions, within)
        state = np.where(every_state[source], rest, settings.state[statement])
        row = state * n_actions + action
        later = statement > base[row]
        row, statement = row[later], statement[later]
        return row, settings.column[statement], settings.values[settings.first[statement]], statement

    def _expanded(
        self, first: NDArray[np.int64], count: NDArray[np.int64]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """The numbers ``first .. first + count - 1`` of all pairs (first, count), and the index of each one's pair."""
        total = int(count.sum())
        if total > MOST_ENTRIES:
            raise self._too_large(total)
        return expanded(first, count)

    def _too_large(self, total: int) -> PomdpFileError:
        return self.source.error(f"{self.keyword} would hold {total:,} probabilities: the limit is {MOST_ENTRIES:,}")

    def _bad_row(self, row: int, total: float | None) -> PomdpFileError:
        """The error for a row whose probabilities sum to ``total``, or that has no probabilities."""
        state, action = divmod(row, self.actions.count)
        role = "state" if self.keyword == "T" else "next state"
        where = f"{self.keyword} for action {self.actions.shown(action)}, {role} {self.states.shown(state)}"
        named = (self.settings.action == action) | (self.settings.action == ALL)
        named &= (self.settings.state == state) | (self.settings.state == ALL)
        place = int(self.settings.place[np.flatnonzero(named)[-1]]) if named.any() else None
        if place is None:
            return self.source.error(f"{where}: no probabilities are given")
        return self.source.error(f"{where}: the probabilities sum to {total or 0:.9g}, not 1", place)


class RewardTable:
    """The table R, which is looked up, never built.

    Args:
        settings: The statements about R.
        sizes: Numbers of actions, states, next states and observations.
    """

    def __init__(self, settings: RewardSettings, sizes: tuple[int, int, int, int]) -> None:
        self._settings, self._sizes = settings, sizes
        n_statements, n_symbols = len(settings.patterns), sizes[3]
        self._by_observation = settings.patterns[:, 3] != ALL
        ends = np.append(settings.first[1:], len(settings.values))
        for i in range(n_statements):
            if settings.stride[i, 1]:
                rows = settings.values[settings.first[i] : ends[i]].reshape(-1, n_symbols)
                self._by_observation[i] = (rows != rows[:, :1]).any()

    def may_depend_on_observation(self, *queries: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Whether the reward of each action, state and next state, ``(n,)`` each, may depend on the observation."""
        patterns = self._settings.patterns[self._by_observation, :3]
        return last_match(patterns, np.column_stack(queries), self._sizes[:3]) >= 0

    def at(self, *queries: NDArray[np.int64]) -> NDArray[np.float64]:
        """The reward of each action, state, next state and observation, each ``(n,)``; 0 where the file says none."""
        settings, asked = self._settings, np.column_stack(np.broadcast_arrays(*queries))
        statement = last_match(settings.patterns, asked, self._sizes)
        found = statement >= 0
        rewards = np.zeros(len(asked))
        chosen = statement[found]
        index = settings.first[chosen] + (settings.stride[chosen] * asked[found, 2:]).sum(axis=1)
        rewards[found] = settings.values[index]
        return rewards


def last_match(patterns: NDArray[np.int64], queries: NDArray[np.int64], sizes: tuple[int, ...]) -> NDArray[np.int64]:
    """The last pattern that fits each query, or -1.

    Args:
        patterns: Numbers, or ``ALL`` which fits any, ``(n, k)``.
        queries: Numbers, ``(m, k)``.
        sizes: Number of values that each of the ``k`` columns can take.
    """
    best = np.full(len(queries), -1)
    free = patterns == ALL
    for kind in np.array(np.unique(free, axis=0)):
        own = np.flatnonzero((free == kind).all(axis=1))
        keys = _keys(np.where(kind, 0, patterns[own]), sizes)
        order = np.argsort(keys, kind="stable")
        ordered = keys[order]
        asked = _keys(np.where(kind, 0, queries), sizes)
        position = np.searchsorted(ordered, asked, side="right") - 1
        fits = (position >= 0) & (ordered[position] == asked)
        best[fits] = np.maximum(best[fits], own[order[position[fits]]])
    return best


def _keys(rows: NDArray[np.int64], sizes: tuple[int, ...]) -> NDArray[np.int64]:
    """A key for each row of numbers: equal rows have equal keys, different rows different ones."""
    return np.asarray(np.ravel_multi_index(tuple(rows.T), sizes), np.int64)
