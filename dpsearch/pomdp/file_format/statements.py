"""The statements of a .POMDP file, with numbers in place of names; ``tables.py`` makes tables of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from dpsearch.pomdp.file_format.preamble import Outline, Preamble
from dpsearch.pomdp.file_format.tokens import ALL, Names, Source


class Form(IntEnum):
    """The part of T or O that a statement sets."""

    CELL = 0  # one probability
    ROW = 1
    MATRIX = 2
    UNIFORM = 3  # a row, or all rows of an action, as in the next two forms
    IDENTITY = 4
    RESET = 5


_SETS_ROWS = {"uniform": Form.UNIFORM, "identity": Form.IDENTITY, "reset": Form.RESET}
_SHAPES = {
    "T": ("T : action : state : next state number", "T : action : state row", "T : action matrix"),
    "O": ("O : action : next state : observation number", "O : action : next state row", "O : action matrix"),
    "R": (
        "R : action : state : next state : observation number",
        "R : action : state : next state row",
        "R : action : state matrix",
    ),
}


@dataclass(frozen=True)
class Settings:
    """The statements about T or O: a later one holds where it contradicts an earlier one.

    Attributes:
        place: Place of each of n statements in the source, ``(n,)``.
        form: :class:`Form` of each statement, ``(n,)``.
        action: Action of each statement, or ``ALL``, ``(n,)``.
        state: State of each statement, or ``ALL``, ``(n,)``: the one left for T, the one arrived in for O.
        column: Next state or observation of each statement that sets a cell, or ``ALL``, ``(n,)``.
        first: First of each statement's numbers in ``values``, ``(n,)``.
        values: All numbers, one statement after the other.
    """

    place: NDArray[np.int64]
    form: NDArray[np.int64]
    action: NDArray[np.int64]
    state: NDArray[np.int64]
    column: NDArray[np.int64]
    first: NDArray[np.int64]
    values: NDArray[np.float64]


@dataclass(frozen=True)
class RewardSettings:
    """The statements about R: a later one holds where it contradicts an earlier one.

    Attributes:
        patterns: Action, state, next state and observation of each statement, each of which may be ``ALL``,
            ``(n, 4)``.
        first: First of each statement's numbers in ``values``, ``(n,)``.
        stride: Distance in ``values`` between the numbers of neighbouring next states, and of neighbouring
            observations, ``(n, 2)``.
        values: All numbers, one statement after the other.
    """

    patterns: NDArray[np.int64]
    first: NDArray[np.int64]
    stride: NDArray[np.int64]
    values: NDArray[np.float64]


@dataclass(frozen=True)
class Statements:
    """All statements of a file.

    Attributes:
        preamble: The head of the file.
        transitions: Statements about T.
        observations: Statements about O.
        rewards: Statements about R.
    """

    preamble: Preamble
    transitions: Settings
    observations: Settings
    rewards: RewardSettings


def parse(source: Source) -> Statements:
    """The statements of a file.

    Raises:
        PomdpFileError: If the text is not in the format.
    """
    return _Parser(source).statements()


class _Parser:
    def __init__(self, source: Source) -> None:
        self.source, self.words, self.outline = source, source.words, Outline(source)
        self.preamble = self.outline.preamble()

    def statements(self) -> Statements:
        preamble = self.preamble
        return Statements(
            preamble,
            self._settings("T", preamble.states),
            self._settings("O", preamble.observations),
            self._rewards(),
        )

    def _settings(self, keyword: str, columns: Names) -> Settings:
        n_states = self.preamble.states.count
        lookups = (self.preamble.actions, self.preamble.states, columns)
        rows: list[tuple[int, ...]] = []
        places, counts = [], []
        for begin, end in self.outline.bodies[keyword]:
            fields, at = self._fields(begin, end, lookups)
            word = self.words[at] if end - at == 1 else ""
            if len(fields) < 3 and word in _SETS_ROWS:
                self._require_meaning(keyword, word, len(fields), columns.count, at)
                form, count = _SETS_ROWS[word], 0
            else:
                form = (Form.MATRIX, Form.ROW, Form.CELL)[len(fields) - 1]
                count = (n_states * columns.count, columns.count, 1)[len(fields) - 1]
                self._require_count(_SHAPES[keyword][len(lookups) - len(fields)], begin, at, end - at, count)
            rows.append((begin, form, *fields, *(ALL, ALL)[len(fields) - 1 :]))
            places.append(at)
            counts.append(count)
        values = self.source.numbers(places, counts)
        self.outline.require_probabilities(values, places, counts)
        place, forms, action, state, column = np.array(rows, np.int64).reshape(-1, 5).T
        return Settings(place, forms, action, state, column, _firsts(counts), values)

    def _rewards(self) -> RewardSettings:
        states, symbols = self.preamble.states, self.preamble.observations
        lookups = (self.preamble.actions, states, states, symbols)
        counts_by_fields = {2: states.count * symbols.count, 3: symbols.count, 4: 1}
        strides_by_fields = {2: (symbols.count, 1), 3: (0, 1), 4: (0, 0)}
        patterns, strides, places, counts = [], [], [], []
        for begin, end in self.outline.bodies["R"]:
            fields, at = self._fields(begin, end, lookups)
            count = counts_by_fields[len(fields)]
            self._require_count(_SHAPES["R"][len(lookups) - len(fields)], begin, at, end - at, count)
            patterns.append((*fields, ALL, ALL)[:4])
            strides.append(strides_by_fields[len(fields)])
            places.append(at)
            counts.append(count)
        return RewardSettings(
            np.array(patterns, np.int64).reshape(-1, 4),
            _firsts(counts),
            np.array(strides, np.int64).reshape(-1, 2),
            self.source.numbers(places, counts),
        )

    def _fields(self, begin: int, end: int, lookups: Sequence[Names]) -> tuple[list[int], int]:
        """The fields between the colons of a statement, and the place where its numbers begin."""
        words, at = self.words, begin + 1
        fields: list[int] = []
        self.outline.require_colon(begin, at)
        while at < end and words[at] == ":":
            if at + 1 == end:
                raise self.source.error(f"nothing follows the last ':' of this {words[begin]}", at)
            if len(fields) == len(lookups):
                raise self.source.error(f"too many ':': {_expected(words[begin])}", at)
            fields.append(self.outline.look_up(lookups[len(fields)], at + 1))
            at += 2
        if len(fields) < len(lookups) - 2:
            raise self.source.error(_expected(words[begin]), begin)
        return fields, at

    def _require_count(self, shape: str, begin: int, at: int, got: int, count: int) -> None:
        if got == count:
            return
        # A number too many is best found at the end, one too few at the beginning
        place = at + count if got > count else begin
        raise self.source.error(
            f"expected {count} number{'s' * (count > 1)} for '{shape}', got {got}", min(place, len(self.words) - 1)
        )

    def _require_meaning(self, keyword: str, word: str, fields: int, columns: int, at: int) -> None:
        """Makes sure that ``uniform``, ``identity`` or ``reset`` has a meaning here."""
        if word == "identity" and (fields == 2 or columns != self.preamble.states.count):
            raise self.source.error("identity is a matrix, with as many columns as there are states", at)
        if word == "reset" and keyword == "O":
            raise self.source.error("reset is a distribution of states: it may follow T, not O", at)


def _expected(keyword: str) -> str:
    return f"expected {', or '.join(_SHAPES[keyword])}"


def _firsts(counts: Sequence[int]) -> NDArray[np.int64]:
    """First index of each of some stretches that lie one behind the other."""
    lengths = np.array(counts, np.int64)
    return np.cumsum(lengths) - lengths
