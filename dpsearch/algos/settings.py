"""Checks of settings: every configuration says in one table which values it accepts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

FINITE = "positive and finite, or null"  # values that ``positive_or_none`` accepts


def require(settings: object, accepted: Mapping[str, tuple[bool, str]]) -> None:
    """Make sure that settings are in range.

    Args:
        settings: Object that has the settings as attributes.
        accepted: For each setting, whether its value is good, and in words which values are.

    Raises:
        ValueError: For the first setting that is out of range, naming it.
    """
    for name, (fits, what) in accepted.items():
        if not fits:
            raise ValueError(f"{name} must be {what}, got {getattr(settings, name)!r}")


def positive_or_none(value: float | None) -> bool:
    """Whether an optional setting is None, or else positive and finite."""
    return value is None or 0.0 < value < math.inf


def is_whole(value: Any, least: int) -> bool:
    """Whether a value is a whole number, and not below the least."""
    return isinstance(value, int) and not isinstance(value, bool) and value >= least


def is_number(value: Any) -> bool:
    """Whether a value is a finite number."""
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
