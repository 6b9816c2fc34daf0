"""Comments for whatever a .POMDP file cannot say of a :class:`TabularPOMDP`; other readers pass over them.

Such a comment is a line of its own, ``#dpsearch: key [...]``, with a list in JSON; several lines with one key
make one list. Symbols, states and actions are numbers here, counting from 0.

========================= ==========================================================================================
key                       list
========================= ==========================================================================================
``state_names``           the names of the states, where they are no words; ``action_names`` and
                          ``observation_names``, too
``features``              the policy's input for each symbol; one-hot by default
``terminal``              the states that end an episode; by default those that an episode does not start in, which
                          every action leads back to, without reward
``start``                 ``[state, probability]``, if not in the order of the states
``transitions``           ``[state, action, [[next state, probability, reward], ...]]`` of the rows that name a next
                          state several times; T and R hold the sum of its probabilities and the mean reward
``observation_pool``      the different distributions over symbols, each as ``[[symbol, probability], ...]``; this and
                          the next two come together, and by default nothing is seen before the first action
``observation_row``       the number in that pool for arriving in each state by each action: one list for every state,
                          or one number if it is the same for all actions
``first_observation_row`` the number in that pool for each state before the first action
========================= ==========================================================================================

Where a comment refines what the file says elsewhere, the two must agree.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpsearch.pomdp.file_format.tokens import PomdpFileError, Source

MARK = "#dpsearch:"
POOL_KEYS = ("observation_pool", "observation_row", "first_observation_row")
NAME_KEYS = ("state_names", "action_names", "observation_names")
KEYS = (*NAME_KEYS, "features", "terminal", "start", "transitions", *POOL_KEYS)
_COMMENT = re.compile(rf"^[ \t]*{MARK}[ \t]*(.*)$", re.MULTILINE)
_ITEMS = 64  # of a list in one line


class Comments:
    """The comments of a file.

    Args:
        source: The words of the file.

    Raises:
        PomdpFileError: If a comment is not in the form that the module describes.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self._lists: dict[str, list[Any]] = {}
        self._lines: dict[str, int] = {}
        line, end = 1, 0
        for match in _COMMENT.finditer(source.raw):
            line += source.raw.count("\n", end, match.start())
            end = match.start()
            key, _, text = match[1].partition(" ")
            if key not in KEYS:
                raise source.error_in_line(f"unknown key {key!r} after {MARK!r}, known are {', '.join(KEYS)}", line)
            try:
                items = json.loads(text)
            except (ValueError, RecursionError) as error:
                raise source.error_in_line(f"{MARK} {key} must be followed by a list in JSON: {error}", line) from error
            if not isinstance(items, list):
                raise source.error_in_line(f"{MARK} {key} must be followed by a list in JSON", line)
            self._lines.setdefault(key, line)
            self._lists.setdefault(key, []).extend(items)
        given = [key for key in POOL_KEYS if key in self]
        if given and len(given) < len(POOL_KEYS):
            raise self.error(given[0], f"must come with {', '.join(key for key in POOL_KEYS if key not in given)}")

    def __contains__(self, key: str) -> bool:
        return key in self._lists

    def error(self, key: str, problem: str) -> PomdpFileError:
        """The error to raise for the list of a key."""
        return self.source.error_in_line(f"{MARK} {key} {problem}", self._lines[key])

    def items(self, key: str) -> list[Any]:
        """The list of a key."""
        return self._lists[key]

    def words(self, key: str, count: int) -> tuple[str, ...]:
        """The list of a key as names.

        Raises:
            PomdpFileError: If the list is not one of ``count`` names.
        """
        items = self.items(key)
        if len(items) != count or not all(isinstance(item, str) for item in items):
            raise self.error(key, f"must list {count} names")
        return tuple(items)

    def indices(self, key: str, below: int) -> NDArray[np.int64]:
        """The list of a key as integers, of any shape.

        Raises:
            PomdpFileError: If the list holds anything else, or a number is out of range.
        """
        array = self.floats(key)
        if (array != np.floor(array)).any() or (array < 0).any() or (array >= below).any():
            raise self.error(key, f"must list whole numbers from 0 to {below - 1}")
        return array.astype(np.int64)

    def floats(self, key: str) -> NDArray[np.float64]:
        """The list of a key as numbers, of any shape.

        Raises:
            PomdpFileError: If the list holds anything else.
        """
        return self.array(key, self.items(key))

    def array(self, key: str, items: Any) -> NDArray[np.float64]:
        """A part of the list of a key, as numbers.

        Raises:
            PomdpFileError: If the part holds anything else.
        """
        try:
            array = np.array(items)
        except (ValueError, OverflowError) as error:
            raise self.error(key, "must list numbers, in rows of the same length") from error
        if array.size and array.dtype.kind not in "iuf":
            raise self.error(key, "must list numbers")
        numbers = array.astype(np.float64)
        if not np.isfinite(numbers).all():
            raise self.error(key, "must list finite numbers")
        return numbers


def comment_lines(key: str, items: Sequence[Any]) -> list[str]:
    """The comment lines that hold a list under a key."""
    parts = [items[first : first + _ITEMS] for first in range(0, len(items), _ITEMS)] or [[]]
    return [f"{MARK} {key} {json.dumps(part)}" for part in parts]
