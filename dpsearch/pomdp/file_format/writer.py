"""Writes a finite POMDP in Cassandra's format, so that reading it gives back a model with the same arrays.

Comments hold whatever the format cannot say, unless a reader would assume it anyway; see ``comments.py``.
Probabilities and rewards are written with all their digits.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from dpsearch.pomdp.distributions import Distributions
from dpsearch.pomdp.file_format.comments import NAME_KEYS, POOL_KEYS, comment_lines
from dpsearch.pomdp.file_format.pool import certain, joined, rows_of, shared, summed, unseen_name
from dpsearch.pomdp.file_format.preamble import MOST_INPUTS, MOST_OBSERVATIONS, MOST_ROWS
from dpsearch.pomdp.file_format.tables import MOST_ENTRIES
from dpsearch.pomdp.file_format.tokens import KEYWORDS
from dpsearch.pomdp.model import TabularPOMDP

T = TypeVar("T")

_WORD = re.compile(r"[a-zA-Z][a-zA-Z0-9_-]*")  # a name in the original format
_NOT_IN_WORDS = re.compile(r"[^a-zA-Z0-9_-]+")
_IN_LINE = 16  # words
_HEAD = """\
# A finite POMDP in Cassandra's format, written by dpsearch. Lines that begin with "#dpsearch:" hold what the format
# cannot say; other programs pass over them."""


def write_pomdp_file(model: TabularPOMDP, path: str | os.PathLike[str]) -> None:
    """Writes a model.

    Args:
        model: The model to write.
        path: Path of the file; an existing file is replaced.

    Raises:
        ValueError: If the model is too large to be read again, or its symbols have no features.
        OSError: If the file cannot be written.
    """
    for size, most, what in (
        (model.n_states * model.n_actions, MOST_ROWS, "states times actions"),
        (model.n_symbols, MOST_OBSERVATIONS, "observations"),
        (len(model.transitions.columns), MOST_ENTRIES, "transitions"),
        (
            int(np.diff(model.observations.starts)[model.observation_row].sum()),
            MOST_ENTRIES,
            "observation probabilities",
        ),
    ):
        if size > most:
            raise ValueError(f"the model has {size:,} {what}: a .POMDP file may have {most:,}")
    if not model.features.size:
        raise ValueError("the model's features are empty: every symbol must have at least one")
    text = "\n".join(_Writer(model).lines()) + "\n"
    Path(path).write_text(text, encoding="ascii")


@dataclass(frozen=True)
class _Row:
    """A row of T and R as it is written.

    Attributes:
        probabilities: Probability of each next state, in the order of the model.
        rewards: Reward of each next state that differs from ``reward``.
        reward: Reward of all other next states.
    """

    probabilities: dict[int, float]
    rewards: dict[int, float]
    reward: float


class _Writer:
    def __init__(self, model: TabularPOMDP) -> None:
        self.model = model
        self.nothing_at_start = _sees_nothing_at_the_start(model)
        self.n_symbols = model.n_symbols - self.nothing_at_start  # symbols that the file knows of
        self.names = (model.state_names, model.action_names, model.observation_names[: self.n_symbols])
        counts = (model.n_states, model.n_actions, self.n_symbols)
        self.words = [
            _words(names) if names else [str(number) for number in range(count)]
            for names, count in zip(self.names, counts, strict=True)
        ]
        self.states, self.actions, self.symbols = self.words
        self.pool = _pairs(summed(model.observations))
        self.rows: list[list[_Row]] = []  # [state][action]
        self.repeating: list[object] = []  # the rows that name a next state several times, for a comment
        self._sort_out_rows()

    def _sort_out_rows(self) -> None:
        model = self.model
        starts = model.transitions.starts.tolist()
        columns, probabilities = model.transitions.columns.tolist(), model.transitions.probabilities.tolist()
        rewards = model.rewards.tolist()
        rows: list[_Row] = []
        for number in range(len(starts) - 1):
            part = slice(starts[number], starts[number + 1])
            own, likely, paid = columns[part], probabilities[part], rewards[part]
            total, mean = dict(zip(own, likely, strict=True)), dict(zip(own, paid, strict=True))
            if len(total) < len(own):
                entries = list(zip(own, likely, paid, strict=True))
                self.repeating.append([*divmod(number, model.n_actions), entries])
                total, mean = dict.fromkeys(own, 0.0), dict.fromkeys(own, 0.0)
                for column, probability, reward in entries:
                    total[column] += probability
                    mean[column] += probability * reward
                mean = {column: mean[column] / total[column] for column in mean}
            some = next(iter(mean.values()))
            general = some if all(reward == some for reward in mean.values()) else 0.0
            rows.append(_Row(total, {c: r for c, r in mean.items() if r != general}, general))
        self.rows = [rows[first : first + model.n_actions] for first in range(0, len(rows), model.n_actions)]

    def lines(self) -> Iterator[str]:
        model = self.model
        yield from (_HEAD, "", f"discount: {float(model.discount)!r}", "values: reward")
        for what, words, names in zip(("states:", "actions:", "observations:"), self.words, self.names, strict=True):
            yield from _wrapped(what, words if names else [str(len(words))])
        comments = list(self._comments())
        yield from ("", *comments) if comments else ()
        yield ""
        yield from self._start()
        yield ""
        for state, rows in enumerate(self.rows):
            yield from self._transitions(state, rows)
        yield ""
        for state, used in enumerate(model.observation_row.tolist()):
            yield from self._seen(state, used)
        yield ""
        for state, rows in enumerate(self.rows):
            yield from self._rewards(state, rows)

    def _comments(self) -> Iterator[str]:
        """Comments for whatever the format cannot say and a reader would not assume."""
        model, start = self.model, self.model.start
        for key, words, names in zip(NAME_KEYS, self.words, self.names, strict=True):
            if names and list(names) != words:
                yield from comment_lines(key, list(names))
        if self.repeating:
            yield from comment_lines("transitions", self.repeating)
        if not self.nothing_at_start:
            used, first = model.observation_row, model.first_observation_row
            same = (used == used[:, :1]).all()
            rows = (_pairs(model.observations), (used[:, 0] if same else used).tolist(), first.tolist())
            for key, items in zip(POOL_KEYS, rows, strict=True):
                yield from comment_lines(key, items)
        if not (np.diff(start.columns) > 0).all():
            yield from comment_lines("start", _pairs(start)[0])
        one_hot = np.array_equal(model.features, np.eye(model.n_symbols, self.n_symbols))
        if not one_hot or self.n_symbols > MOST_INPUTS:
            yield from comment_lines("features", model.features.tolist())
        starting = set(start.columns.tolist())
        taken = [state not in starting and self._is_final(state) for state in range(model.n_states)]
        if taken != model.terminal.tolist():
            yield from comment_lines("terminal", np.flatnonzero(model.terminal).tolist())

    def _is_final(self, state: int) -> bool:
        """Whether every action leads from the state back to it without reward."""
        return all(set(row.probabilities) == {state} and not row.reward and not row.rewards for row in self.rows[state])

    # Statements

    def _start(self) -> Iterator[str]:
        start = summed(self.model.start)
        states, probabilities = start.columns.tolist(), start.probabilities.tolist()
        if probabilities == [1.0]:
            yield f"start: {self.states[states[0]]}"
        elif set(probabilities) == {1 / len(states)}:
            yield from _wrapped("start include:", [self.states[state] for state in states])
        else:
            yield from _wrapped("start:", map(repr, start.dense()[0].tolist()))

    def _merged(self, items: list[T]) -> Iterator[tuple[str, T]]:
        """Each action's word with its statement; ``*`` with one statement if all actions have the same."""
        if len(items) > 1 and all(item == items[0] for item in items):
            yield "*", items[0]
        else:
            yield from zip(self.actions, items, strict=True)

    def _transitions(self, state: int, rows: list[_Row]) -> Iterator[str]:
        for action, entries in self._merged([list(row.probabilities.items()) for row in rows]):  # order matters
            for following, probability in entries:
                yield f"T : {action} : {self.states[state]} : {self.states[following]} {probability!r}"

    def _seen(self, state: int, used: list[int]) -> Iterator[str]:
        for action, row in self._merged(used):
            for symbol, probability in self.pool[row]:
                yield f"O : {action} : {self.states[state]} : {self.symbols[symbol]} {probability!r}"

    def _rewards(self, state: int, rows: list[_Row]) -> Iterator[str]:
        for action, (general, own) in self._merged([(row.reward, row.rewards) for row in rows]):
            if general:
                yield f"R : {action} : {self.states[state]} : * : * {general!r}"
            for following, reward in own.items():
                yield f"R : {action} : {self.states[state]} : {self.states[following]} : * {reward!r}"


def _sees_nothing_at_the_start(model: TabularPOMDP) -> bool:
    """Whether a reader would give the model this last symbol and these rows of the pool without a comment."""
    nothing = model.n_symbols - 1
    names, first = model.observation_names, model.first_observation_row
    used, which = np.unique(model.observation_row, return_inverse=True)
    seen = summed(rows_of(model.observations, used))
    if not nothing or (seen.columns == nothing).any() or (first != first[0]).any() or model.features[nothing].any():
        return False
    if names and names[nothing] != unseen_name(names[:nothing]):
        return False
    pool, row = shared(joined(seen, certain(np.array([nothing]), model.n_symbols)))
    return (
        _equal(pool, model.observations)
        and np.array_equal(row[which], model.observation_row)
        and bool(first[0] == row[-1])
    )


def _pairs(table: Distributions) -> list[list[tuple[int, float]]]:
    """Column and probability of each entry, row by row."""
    starts = table.starts.tolist()
    pairs = list(zip(table.columns.tolist(), table.probabilities.tolist(), strict=True))
    return [pairs[starts[row] : starts[row + 1]] for row in range(table.n_rows)]


def _equal(one: Distributions, other: Distributions) -> bool:
    return (
        np.array_equal(one.starts, other.starts)
        and np.array_equal(one.columns, other.columns)
        and np.array_equal(one.probabilities, other.probabilities)
    )


def _words(names: tuple[str, ...]) -> list[str]:
    """A different word for each name: the name itself if it is a word."""
    words: dict[str, None] = {}
    for number, name in enumerate(names):
        word = name
        if not _is_word(word):
            word = _NOT_IN_WORDS.sub("-", name).strip("-")
        if not _is_word(word):  # it begins with a digit, or is a keyword
            word = f"n{word}"
        if word in words:
            word = f"{word}-{number}"
        while word in words:
            word += "-"
        words[word] = None
    return list(words)


def _is_word(name: str) -> bool:
    return _WORD.fullmatch(name) is not None and name not in KEYWORDS


def _wrapped(head: str, words: Iterable[str]) -> Iterator[str]:
    """A statement, broken into lines."""
    parts = [head, *words]
    for first in range(0, len(parts), _IN_LINE):
        yield " ".join(parts[first : first + _IN_LINE])
