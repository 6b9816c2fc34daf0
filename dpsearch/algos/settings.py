"""Checks of settings: every config says in one table what it accepts."""

from __future__ import annotations

import math
from collections.abc import Mapping

FINITE = "positive and finite, or null"  # what ``positive_or_none`` accepts


def require(settings: object, accepted: Mapping[str, tuple[bool, str]]) -> None:
    """Make sure that settings are in range.

    Args:
        settings: What has them as attributes.
        accepted: For each setting, whether its value is good, and which values are.

    Raises:
        ValueError: For the first that is not, naming it.
    """
    for name, (fits, what) in accepted.items():
        if not fits:
            raise ValueError(f"{name} must be {what}, got {getattr(settings, name)!r}")


def positive_or_none(value: float | None) -> bool:
    """Whether a setting that may be left out is left out, or else positive and finite."""
    return value is None or 0.0 < value < math.inf
