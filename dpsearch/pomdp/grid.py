"""Mazes on a grid, read from a drawing: its cells and the ways between them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Cell = tuple[int, int]
"""Row and column, counted from the top left."""

DIRECTIONS = ("north", "east", "south", "west")
NORTH, EAST, SOUTH, WEST = range(4)

_ROCK, _PLAIN = "#", "."
_STEPS = ((-1, 0), (0, 1), (1, 0), (0, -1))


@dataclass(frozen=True, eq=False)
class Grid:
    """The cells of a maze, C in number, and the walls between them.

    Attributes:
        cells: Row and column of each cell. Plain cells come first, then marked ones, each in the order of reading.
        marks: The character that each cell is drawn with.
        walls: Whether there is a wall in each of ``DIRECTIONS``, ``(C, 4)`` bool.
        neighbours: The cell in each direction, ``(C, 4)``; the cell itself where there is a wall.
    """

    cells: tuple[Cell, ...]
    marks: str
    walls: NDArray[np.bool_]
    neighbours: NDArray[np.int64]

    @classmethod
    def read(cls, rows: Sequence[str]) -> Grid:
        """Reads a drawing, a string for each row: ``#`` is rock, ``.`` a plain cell, anything else a marked one."""
        drawn = {
            (row, column): mark for row, line in enumerate(rows) for column, mark in enumerate(line) if mark != _ROCK
        }
        cells = sorted(drawn, key=lambda cell: drawn[cell] != _PLAIN)  # stable: each kind stays in order
        number = {cell: i for i, cell in enumerate(cells)}
        beside = np.array(
            [[number.get((row + down, column + right), -1) for down, right in _STEPS] for row, column in cells]
        )
        return cls(
            cells=tuple(cells),
            marks="".join(drawn[cell] for cell in cells),
            walls=beside < 0,
            neighbours=np.where(beside < 0, np.arange(len(cells))[:, None], beside),
        )


def walls_seen(sides: Sequence[str], walls: Iterable[bool]) -> str:
    """Walls in words: "no walls", "wall north", "walls north, west"."""
    there = [side for side, wall in zip(sides, walls, strict=True) if wall]
    if not there:
        return "no walls"
    return ("wall " if len(there) == 1 else "walls ") + ", ".join(there)
