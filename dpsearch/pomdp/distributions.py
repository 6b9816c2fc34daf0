"""Sparse tables of probability distributions over one finite set."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

_TOLERANCE = 1e-6  # how far from 1 the sum of a row may lie


@dataclass(frozen=True, eq=False)
class Distributions:
    """Compressed sparse rows of probabilities; row ``i`` owns the entries ``starts[i]:starts[i + 1]``.

    A row may name the same column twice: the probabilities add up.

    Attributes:
        starts: First entry of each row, and the end of the last row, ``(n_rows + 1,)`` int64.
        columns: Outcome of each entry, ``(n_entries,)`` int64.
        probabilities: Probability of each entry, ``(n_entries,)`` float64.
        n_columns: Number of outcomes.
    """

    starts: NDArray[np.int64]
    columns: NDArray[np.int64]
    probabilities: NDArray[np.float64]
    n_columns: int

    @classmethod
    def from_entries(
        cls, rows: ArrayLike, columns: ArrayLike, probabilities: ArrayLike, shape: tuple[int, int]
    ) -> Distributions:
        """Collects entries given in any order; see :func:`by_row` for the order they end up in.

        Args:
            rows: Row of each entry, ``(n_entries,)``.
            columns: Column of each entry, broadcast to the same shape.
            probabilities: Probability of each entry, broadcast to the same shape.
            shape: ``(n_rows, n_columns)``.

        Raises:
            ValueError: If a row is outside ``[0, n_rows)``.
        """
        rows, columns, probabilities = np.broadcast_arrays(rows, columns, probabilities)
        order = by_row(rows, probabilities)
        return cls(
            row_starts(rows[order], shape[0]),
            columns[order].astype(np.int64),
            probabilities[order].astype(np.float64),
            shape[1],
        )

    @classmethod
    def from_dense(cls, matrix: ArrayLike) -> Distributions:
        """The rows of a dense matrix ``(n_rows, n_columns)``."""
        matrix = np.atleast_2d(np.asarray(matrix, np.float64))
        rows, columns = np.nonzero(matrix)
        n_rows, n_columns = matrix.shape
        return cls.from_entries(rows, columns, matrix[rows, columns], (n_rows, n_columns))

    @property
    def n_rows(self) -> int:
        """Number of distributions."""
        return len(self.starts) - 1

    def row_of_entry(self) -> NDArray[np.int64]:
        """The row that each entry belongs to, ``(n_entries,)``."""
        return np.repeat(np.arange(self.n_rows), np.diff(self.starts))

    def dense(self) -> NDArray[np.float64]:
        """All probabilities, ``(n_rows, n_columns)``."""
        matrix = np.zeros((self.n_rows, self.n_columns))
        np.add.at(matrix, (self.row_of_entry(), self.columns), self.probabilities)
        return matrix

    def check(self, name: str, describe: Callable[[int], str]) -> None:
        """Makes sure that every row is a probability distribution.

        Args:
            name: Word for a column in the error message: "next state".
            describe: Words for row ``i`` in the error message: "state 3, action 1".

        Raises:
            ValueError: If a row is empty or does not sum to 1, a column is out of range or a probability is
                not above 0 (NaN is not).
        """
        if len(self.starts) < 2 or self.starts[0] != 0 or self.starts[-1] != len(self.columns):
            raise ValueError(f"starts must run from 0 to the number of entries, {len(self.columns)}")
        if len(self.columns) != len(self.probabilities):
            raise ValueError(f"{len(self.columns)} columns but {len(self.probabilities)} probabilities")
        lengths = np.diff(self.starts)
        if (lengths < 1).any():
            raise ValueError(f"no {name} is given for {describe(int(np.argmax(lengths < 1)))}")
        outside = (self.columns < 0) | (self.columns >= self.n_columns)
        bad = outside | ~(self.probabilities > 0)
        if bad.any():
            entry = int(np.argmax(bad))
            row = int(np.searchsorted(self.starts, entry, side="right")) - 1
            if outside[entry]:
                problem = f"is outside 0 .. {self.n_columns - 1}"
            else:
                problem = f"has probability {self.probabilities[entry]:g}, which is not above 0"
            raise ValueError(f"{name} {self.columns[entry]} of {describe(row)} {problem}")
        sums = np.add.reduceat(self.probabilities, self.starts[:-1])
        wrong = ~(np.abs(sums - 1) <= _TOLERANCE)
        if wrong.any():
            row = int(np.argmax(wrong))
            raise ValueError(f"{name} of {describe(row)}: the probabilities sum to {sums[row]:.9g}, not 1")


def by_row(rows: NDArray[np.int64], probabilities: NDArray[np.float64]) -> NDArray[np.int64]:
    """The entries worth keeping, row after row: zeros are left out, entries of one row keep their order."""
    kept = np.flatnonzero(probabilities != 0)
    order: NDArray[np.int64] = kept[np.argsort(rows[kept], kind="stable")]
    return order


def row_starts(sorted_rows: NDArray[np.int64], n_rows: int) -> NDArray[np.int64]:
    """First entry of each row among entries sorted by row, and the end of the last row, ``(n_rows + 1,)``.

    Raises:
        ValueError: If a row is outside ``[0, n_rows)``.
    """
    if len(sorted_rows) and not 0 <= sorted_rows[0] <= sorted_rows[-1] < n_rows:
        raise ValueError(f"rows must be in 0 .. {n_rows - 1}, got {sorted_rows[0]} .. {sorted_rows[-1]}")
    starts = np.zeros(n_rows + 1, np.int64)
    np.cumsum(np.bincount(sorted_rows, minlength=n_rows), out=starts[1:])
    return starts


def expanded(first: NDArray[np.int64], count: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The numbers ``first .. first + count - 1`` of all pairs (first, count), and the index of each one's pair."""
    pair = np.repeat(np.arange(len(count)), count)
    return first[pair] + np.arange(len(pair)) - (np.cumsum(count) - count)[pair], pair
