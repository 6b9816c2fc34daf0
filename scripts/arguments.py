"""Types and options that the programs' command lines have in common."""

from argparse import ArgumentParser, ArgumentTypeError
from collections.abc import Callable, Iterable, Mapping
from typing import TypeVar

T = TypeVar("T")


def at_least(minimum: int) -> Callable[[str], int]:
    """A whole number that is not below the minimum, as a type for argparse."""

    def whole(text: str) -> int:
        if not text.isdecimal() or int(text) < minimum:
            raise ArgumentTypeError(f"expected a whole number of at least {minimum}, got {text!r}")
        return int(text)

    return whole


def at_least_one(text: str) -> list[int]:
    """Whole numbers of at least 1, separated by commas, as a type for argparse; ascending, each once."""
    return sorted({at_least(1)(part) for part in text.split(",")})


def named(known: Mapping[str, T]) -> Callable[[str], list[T]]:
    """The values of some names, separated by commas, as a type for argparse."""

    def chosen(text: str) -> list[T]:
        names = list(dict.fromkeys(text.split(",")))
        unknown = [name for name in names if name not in known]
        if unknown:
            raise ArgumentTypeError(f"unknown name {unknown[0]!r}: choose from {', '.join(known)}")
        return [known[name] for name in names]

    return chosen


def add_choice(
    parser: ArgumentParser, option: str, known: Mapping[str, T], default: Iterable[str] | None = None
) -> None:
    """Add an option that takes names, separated by commas, and gives the list of their values.

    Args:
        parser: The parser that gets the option.
        option: Name of the option, such as ``--methods``.
        known: The values by name.
        default: Names that are chosen by default; None for all.
    """
    names = list(known if default is None else default)
    parser.add_argument(
        option, type=named(known), default=[known[name] for name in names], metavar="NAME,..",
        help=f"of {', '.join(known)}; default: {','.join(names)}",
    )  # fmt: skip
