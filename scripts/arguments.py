"""What the programs accept on their command lines."""

from argparse import ArgumentTypeError
from collections.abc import Callable, Mapping
from typing import TypeVar

T = TypeVar("T")


def at_least(minimum: int) -> Callable[[str], int]:
    """A whole number that is not below the minimum, as a type for argparse."""

    def whole(text: str) -> int:
        if not text.isdecimal() or int(text) < minimum:
            raise ArgumentTypeError(f"expected a whole number of at least {minimum}, got {text!r}")
        return int(text)

    return whole


def named(known: Mapping[str, T]) -> Callable[[str], list[T]]:
    """What some names stand for, separated by commas, as a type for argparse."""

    def chosen(text: str) -> list[T]:
        names = list(dict.fromkeys(text.split(",")))
        unknown = [name for name in names if name not in known]
        if unknown:
            raise ArgumentTypeError(f"unknown name {unknown[0]!r}: choose from {', '.join(known)}")
        return [known[name] for name in names]

    return chosen
