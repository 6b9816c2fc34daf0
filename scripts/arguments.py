"""What the programs accept on their command lines."""

from argparse import ArgumentTypeError
from collections.abc import Callable


def at_least(minimum: int) -> Callable[[str], int]:
    """A whole number that is not below the minimum, as a type for argparse."""

    def whole(text: str) -> int:
        if not text.isdecimal() or int(text) < minimum:
            raise ArgumentTypeError(f"expected a whole number of at least {minimum}, got {text!r}")
        return int(text)

    return whole
