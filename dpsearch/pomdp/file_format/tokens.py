"""A .POMDP file as words that know their lines, and the one error for all that can be wrong with such a file."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

ALL = -1
"""The number for ``*``, which stands for all states, actions or observations."""

HEADERS = ("discount", "values", "states", "actions", "observations")
"""The first words of the statements that a file must have."""

STATEMENTS = frozenset((*HEADERS, "start", "T", "O", "R"))
"""The words that begin a statement; no other word does, so they show where the one before ends."""

KEYWORDS = STATEMENTS | {"reward", "cost", "uniform", "identity", "reset", "include", "exclude"}

_COMMENT = re.compile(r"#[^\n]*")
_LONE_SIGN = re.compile(r"(?<![^\s:*])([+-])(\s+)(?=[.\d])")
_DIGITS = re.compile(r"[-+.0-9eE ]*")  # without letters, so neither NaN nor infinity
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_UNDECODED = re.compile("[\udc80-\udcff]")  # bytes that are no UTF-8
_LISTED = 8  # names that a message lists


class PomdpFileError(ValueError):
    """A .POMDP file that cannot be read. The message names the file, the line where there is one, and what is wrong."""


@dataclass(frozen=True)
class Source:
    """The words of a file; the numbers of words are its places.

    Attributes:
        path: Path of the file, for messages.
        raw: The text of the file.
        text: The text without comments, on as many lines.
        words: Words of ``text``, split at whitespace; colons and asterisks are words of their own.
    """

    path: str
    raw: str
    text: str
    words: list[str] = field(repr=False)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Source:
        """Reads a file.

        Raises:
            PomdpFileError: If there is no such file, or it does not hold text.
        """
        name = os.fspath(path)
        try:
            if not Path(name).is_file():  # a device may never end
                raise PomdpFileError(f"{name}: {'is not a file' if Path(name).exists() else 'there is no such file'}")
            data = Path(name).read_bytes()
        except OSError as error:
            raise PomdpFileError(f"{name}: cannot be read: {error.strerror}") from error
        source = cls.of(data.decode("utf-8-sig", "surrogateescape"), name)  # comments may be in any encoding
        for number, line in enumerate(source.text.split("\n"), 1):
            if _UNDECODED.search(line):
                raise source.error_in_line("this is not text in UTF-8", number)
        return source

    @classmethod
    def of(cls, raw: str, name: str) -> Source:
        """The words of a text; messages call it ``name``."""
        raw = raw.replace("\r\n", "\n").replace("\r", "\n")
        text = _COMMENT.sub("", raw)
        text = _LONE_SIGN.sub(r"\2\1", text)  # a sign may stand apart from its number
        return cls(name, raw, text, _words(text))

    def error(self, problem: str, place: int | None = None) -> PomdpFileError:
        """The error to raise for a problem, at a place or with the file as a whole."""
        return self.error_in_line(problem, None if place is None else self.line(place))

    def error_in_line(self, problem: str, line: int | None) -> PomdpFileError:
        """The error to raise for a problem in a line."""
        where = "" if line is None else f", line {line}"
        return PomdpFileError(f"{self.path}{where}: {problem}")

    def line(self, place: int) -> int:
        """The line of a word, counting from 1."""
        remaining, number = place, 0
        for number, line in enumerate(self.text.split("\n"), 1):  # noqa: B007
            remaining -= len(_words(line))
            if remaining < 0:
                break
        return number

    def number(self, place: int) -> float:
        """The number at a place.

        Raises:
            PomdpFileError: If the word there is no number.
        """
        return float(self.numbers([place], [1])[0])

    def numbers(self, places: Sequence[int], counts: Sequence[int]) -> NDArray[np.float64]:
        """The numbers in some stretches of words, one stretch behind the other.

        Args:
            places: First place of each stretch.
            counts: Number of words in each stretch.

        Raises:
            PomdpFileError: If a word is no number, or not a finite one.
        """
        words = self.words
        stretches = (words[place : place + count] for place, count in zip(places, counts, strict=True))
        chosen = list(chain.from_iterable(stretches))
        try:
            values = np.array(list(map(float, chosen)), np.float64)
            fine = _DIGITS.fullmatch(" ".join(chosen)) is not None and bool(np.isfinite(values).all())
        except ValueError:
            fine = False
        if not fine:
            stretches_of_places = (range(place, place + count) for place, count in zip(places, counts, strict=True))
            raise next(
                self.error(f"expected a number, got {words[place]!r}", place)
                for place in chain.from_iterable(stretches_of_places)
                if not (_NUMBER.fullmatch(words[place]) and np.isfinite(float(words[place])))
            )
        return values


class Names(dict[str, int]):
    """A dictionary from names to numbers; a number names itself, and ``*`` stands for all.

    Args:
        what: Kind of the things named, for messages: "state".
        names: Names of the things, or none.
        count: Number of the things.

    Attributes:
        what: Kind of the things named, for messages: "state".
        names: Names of the things, or none.
        count: Number of the things.
    """

    def __init__(self, what: str, names: tuple[str, ...], count: int) -> None:
        super().__init__({name: number for number, name in enumerate(names)})
        self["*"] = ALL
        self.what = what
        self.names = names
        self.count = count

    def __missing__(self, word: str) -> int:
        if word.isascii() and word.isdigit() and len(word) < 10 and int(word) < self.count:
            self[word] = int(word)
            return self[word]
        raise KeyError(word)

    def shown(self, number: int) -> str:
        """Name of the thing with a number, for messages."""
        return self.names[number] if self.names else str(number)

    def problem(self, word: str) -> str:
        """The problem with a word that names nothing, in words."""
        known = f"numbers from 0 to {self.count - 1}"
        if self.names:
            listed = ", ".join(self.names[:_LISTED]) + (", ..." if len(self.names) > _LISTED else "")
            known = f"{listed}, or {known}"
        if re.fullmatch(r"\d+", word, re.ASCII):
            return f"{self.what} {word} is out of range: the {self.what}s are {known}"
        return f"unknown {self.what} {word!r}: the {self.what}s are {known}"


def is_name(word: str) -> bool:
    """Whether a word can be the name of something: it begins with a letter or underscore, and is no keyword."""
    return (word[:1].isalpha() or word[:1] == "_") and word not in KEYWORDS


def _words(text: str) -> list[str]:
    return text.replace(":", " : ").replace("*", " * ").split()
