"""Distributions in a canonical form, in which equal ones are found; for reading and writing .POMDP files."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dpsearch.pomdp.distributions import Distributions, expanded, row_starts

_AGREEMENT = 1e-9  # two numbers that were meant to be the same may differ so much, absolutely or relatively


def shared(table: Distributions) -> tuple[Distributions, NDArray[np.int64]]:
    """The distinct rows of a table, and the number of the distinct row that each row equals.

    Args:
        table: Rows whose columns are sorted, and differ within one row.

    Returns:
        The rows in the order in which ``numpy.unique`` puts those of the dense matrix, and ``(n_rows,)``.
    """
    columns, probabilities, starts = table.columns.tobytes(), table.probabilities.tobytes(), table.starts.tolist()
    found: dict[tuple[bytes, bytes], int] = {}
    examples: list[int] = []  # one row of each kind
    kind = np.empty(table.n_rows, np.int64)
    for row in range(table.n_rows):
        entries = slice(8 * starts[row], 8 * starts[row + 1])
        key = (columns[entries], probabilities[entries])
        kind[row] = found.setdefault(key, len(found))
        if kind[row] == len(examples):
            examples.append(row)

    def place(number: int) -> list[tuple[int, float]]:
        """A key by which rows are sorted as their dense forms would be, number by number."""
        entries = slice(starts[examples[number]], starts[examples[number] + 1])
        return list(zip((-table.columns[entries]).tolist(), table.probabilities[entries].tolist(), strict=True))

    order = sorted(range(len(examples)), key=place)
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    return rows_of(table, np.array(examples, np.int64)[order]), rank[kind]


def rows_of(table: Distributions, rows: NDArray[np.int64]) -> Distributions:
    """The chosen rows of a table, in this order."""
    lengths = np.diff(table.starts)[rows]
    entry, _ = expanded(table.starts[rows], lengths)
    return Distributions(
        np.append(0, np.cumsum(lengths)), table.columns[entry], table.probabilities[entry], table.n_columns
    )


def joined(one: Distributions, other: Distributions) -> Distributions:
    """The rows of both tables, over the columns of the wider one."""
    return Distributions(
        np.append(one.starts, one.starts[-1] + other.starts[1:]),
        np.append(one.columns, other.columns),
        np.append(one.probabilities, other.probabilities),
        max(one.n_columns, other.n_columns),
    )


def certain(columns: NDArray[np.int64], n_columns: int) -> Distributions:
    """Rows with one certain outcome each."""
    return Distributions(np.arange(len(columns) + 1), columns, np.ones(len(columns)), n_columns)


def summed(table: Distributions) -> Distributions:
    """The distributions with sorted columns, each named once in a row."""
    cells, which = np.unique(table.row_of_entry() * table.n_columns + table.columns, return_inverse=True)
    rows, columns = np.divmod(cells, table.n_columns)
    sums = np.bincount(which, table.probabilities, len(cells)).astype(np.float64)
    return Distributions(row_starts(rows, table.n_rows), columns, sums, table.n_columns)


def disagreement(one: Distributions, other: Distributions) -> int | None:
    """The first row in which two tables of one size differ; None if there is none."""
    one, other = summed(one), summed(other)
    lengths = np.diff(one.starts) != np.diff(other.starts)
    end = int(one.starts[np.argmax(lengths)]) if lengths.any() else len(one.columns)  # entries that can be compared
    differs = one.columns[:end] != other.columns[:end]
    difference = np.abs(one.probabilities[:end] - other.probabilities[:end])
    differs |= difference > _AGREEMENT * np.maximum(1.0, np.abs(one.probabilities[:end]))
    if differs.any():
        return int(np.searchsorted(one.starts, np.argmax(differs), side="right")) - 1
    return int(np.argmax(lengths)) if lengths.any() else None


def unseen_name(names: tuple[str, ...]) -> str:
    """A name for the symbol that stands for having seen nothing yet."""
    name = "nothing"
    while name in names:
        name += "-yet"
    return name
