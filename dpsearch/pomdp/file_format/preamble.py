"""The head of a .POMDP file: discount factor, sign of the rewards, names, and where episodes start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpsearch.pomdp.file_format.tokens import ALL, HEADERS, STATEMENTS, Names, Source, is_name

MOST_ROWS = 2_000_000  # states times actions
MOST_OBSERVATIONS = 100_000
MOST_INPUTS = 4096  # inputs of a policy that has one for each observation
ROUNDING = 1e-5  # how far a sum of probabilities that were written with few digits may be off
EXACT = 1e-6  # sums that are closer to 1 are left as they are: TabularPOMDP accepts them


@dataclass(frozen=True)
class Preamble:
    """The head of a file, which holds for all of it.

    Attributes:
        discount: Discount factor, in [0, 1].
        cost: Whether the numbers of R are costs.
        states: Names of the states.
        actions: Names of the actions.
        observations: Names of the observations.
        start: Probability of each start state, ``(S,)``.
    """

    discount: float
    cost: bool
    states: Names
    actions: Names
    observations: Names
    start: NDArray[np.float64]


class Outline:
    """The extents of the statements of a file.

    Args:
        source: The words of the file.

    Attributes:
        source: The words of the file.
        bodies: First place of each statement and the place behind its last, by its first word.

    Raises:
        PomdpFileError: If the file does not begin with a statement.
    """

    def __init__(self, source: Source) -> None:
        self.source, words = source, source.words
        if not words:
            raise source.error(f"the file is empty: it must give {', '.join(HEADERS)}")
        begins = [place for place, word in enumerate(words) if word in STATEMENTS]
        if not begins or begins[0] > 0:
            expected = ", ".join([*HEADERS, "start", "T", "O", "R"])
            raise source.error(f"expected one of {expected}, got {words[0]!r}", 0)
        self.bodies: dict[str, list[tuple[int, int]]] = {word: [] for word in STATEMENTS}
        for begin, end in zip(begins, [*begins[1:], len(words)], strict=True):
            self.bodies[words[begin]].append((begin, end))

    def require_colon(self, keyword: int, place: int) -> None:
        """Makes sure that there is a colon behind the keyword of a statement.

        Raises:
            PomdpFileError: If there is no colon.
        """
        words = self.source.words
        if place >= len(words) or words[place] != ":":
            raise self.source.error(
                f"expected ':' after {words[keyword]}, which is a keyword and cannot be a name", keyword
            )

    def preamble(self) -> Preamble:
        """Reads the head of a file.

        Raises:
            PomdpFileError: If something is missing, wrong or too large.
        """
        missing = [name for name in HEADERS if not self.bodies[name]]
        if missing:
            raise self.source.error(f"{missing[0]}: is missing: a file must give {', '.join(HEADERS)}")
        states, actions, observations = (self._names(what) for what in ("state", "action", "observation"))
        rows = states.count * actions.count
        for header, size, most, what in (
            ("states", rows, MOST_ROWS, f"{states.count:,} states times {actions.count:,} actions"),
            ("observations", observations.count, MOST_OBSERVATIONS, f"{observations.count:,} observations"),
        ):
            if size > most:
                raise self.source.error(f"{what} are too many: the limit is {most:,}", self.bodies[header][0][0])
        return Preamble(self.discount(), self._cost(), states, actions, observations, self._start(states))

    def discount(self) -> float:
        """The discount factor.

        Raises:
            PomdpFileError: If the discount is missing or wrong.
        """
        if not self.bodies["discount"]:
            raise self.source.error("discount: is missing")
        place, end = self._header("discount")
        self._require_one(place, end, "a number from 0 to 1")
        value = self.source.number(place)
        if not 0 <= value <= 1:
            raise self.source.error(f"discount must be from 0 to 1, got {self.source.words[place]}", place)
        return value

    def _header(self, keyword: str) -> tuple[int, int]:
        """First place behind ``keyword :``, and the place behind the statement."""
        begin, end = self.bodies[keyword][0]
        self._require_once(keyword)
        self.require_colon(begin, begin + 1)
        if end - begin < 3:
            if end < len(self.source.words):
                self.require_colon(end, end + 1)  # else a keyword is meant as the first name
            raise self.source.error(f"nothing follows {keyword}:", begin)
        return begin + 2, end

    def _require_once(self, keyword: str) -> None:
        first, *others = self.bodies[keyword]
        if others:
            if keyword != "start":  # which may be followed by include or exclude
                self.require_colon(others[0][0], others[0][0] + 1)  # else it is meant as a name
            line = self.source.line(first[0])
            raise self.source.error(f"{keyword} is given a second time, after line {line}", others[0][0])

    def _require_one(self, place: int, end: int, what: str) -> None:
        if end - place > 1:
            raise self.source.error(f"expected only {what}, got {self.source.words[place + 1]!r} too", place + 1)

    def _cost(self) -> bool:
        place, end = self._header("values")
        self._require_one(place, end, "reward or cost")
        word = self.source.words[place]
        if word not in ("reward", "cost"):
            raise self.source.error(f"values must be reward or cost, got {word!r}", place)
        return word == "cost"

    def _names(self, what: str) -> Names:
        place, end = self._header(f"{what}s")
        words = self.source.words[place:end]
        if len(words) == 1 and words[0].isascii() and words[0].isdigit():
            count = int(words[0]) if len(words[0]) < 16 else 10**15  # too many anyway
            if count < 1:
                raise self.source.error(f"there must be at least one {what}", place)
            return Names(what, (), count)
        seen: dict[str, int] = {}
        for at, word in enumerate(words, place):
            if not is_name(word):
                raise self.source.error(
                    f"{word!r} cannot be one of the names of {what}s: expected names, which begin with a letter and "
                    "are no keywords, or a whole number, how many there are",
                    at,
                )
            if word in seen:
                line = self.source.line(seen[word])
                raise self.source.error(f"two {what}s are called {word}, the other one in line {line}", at)
            seen[word] = at
        return Names(what, tuple(words), len(words))

    def _start(self, states: Names) -> NDArray[np.float64]:
        uniform = np.full(states.count, 1 / states.count)
        if not self.bodies["start"]:
            return uniform
        begin, end = self.bodies["start"][0]
        if self.source.words[begin + 1 : begin + 2] in (["include"], ["exclude"]):
            return self._start_among(states, begin, end)
        place, end = self._header("start")
        words = self.source.words[place:end]
        if words == ["uniform"]:
            return uniform
        if len(words) == 1 and (is_name(words[0]) or words[0] == "0" or (words[0].isdigit() and states.count > 1)):
            return np.array(np.arange(states.count) == self.look_up(states, place), np.float64)
        if len(words) != states.count or any(word in states and is_name(word) for word in words):
            raise self.source.error(
                f"start must be a state, uniform, or the probabilities of all {states.count} states, "
                f"got {len(words)} words; several states are listed after 'start include:'",
                place,
            )
        probabilities = self.source.numbers([place], [states.count])
        self.require_probabilities(probabilities, [place], [states.count])
        total = float(probabilities.sum())
        if abs(total - 1) > ROUNDING:
            raise self.source.error(f"the probabilities of the start states sum to {total:.9g}, not 1", place)
        return probabilities / total if abs(total - 1) > EXACT else probabilities

    def _start_among(self, states: Names, begin: int, end: int) -> NDArray[np.float64]:
        self._require_once("start")
        kind = f"start {self.source.words[begin + 1]}"
        if begin + 3 >= end or self.source.words[begin + 2] != ":":
            raise self.source.error(f"expected ':' and states after {kind}", begin)
        named = np.zeros(states.count, np.bool_)
        for place in range(begin + 3, end):
            number = self.look_up(states, place)
            if number == ALL:
                raise self.source.error(f"{kind} takes states, not '*'", place)
            named[number] = True
        possible = named if kind == "start include" else ~named
        if not possible.any():
            raise self.source.error(f"{kind} leaves no state to start in", begin)
        return np.array(possible / possible.sum(), np.float64)

    def look_up(self, names: Names, place: int) -> int:
        """The number of the state, action or observation that the word at a place names.

        Raises:
            PomdpFileError: If the word names nothing.
        """
        try:
            return names[self.source.words[place]]
        except KeyError:
            raise self.source.error(names.problem(self.source.words[place]), place) from None

    def require_probabilities(self, values: NDArray[np.float64], places: Sequence[int], counts: Sequence[int]) -> None:
        """Makes sure that the numbers in some stretches of words are probabilities.

        Raises:
            PomdpFileError: If one of them is not.
        """
        wrong = (values < 0) | (values > 1 + ROUNDING)
        if wrong.any():
            index = int(np.argmax(wrong))
            ends = np.cumsum(counts)
            stretch = int(np.searchsorted(ends, index, side="right"))
            place = places[stretch] + counts[stretch] - int(ends[stretch]) + index
            raise self.source.error(f"a probability must be from 0 to 1, got {self.source.words[place]}", place)
