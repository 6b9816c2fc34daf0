"""Settings that are true or false, of which OmegaConf takes any number for true."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dpsearch.errors import RunError


def check_booleans(given: Mapping[Any, Any], settings: Any, section: str = "") -> None:
    """Refuse numbers other than 0 and 1 for true and false.

    Args:
        given: Settings as the command line or a file gives them.
        settings: The object that was made of them.
        section: What precedes the names of these settings.

    Raises:
        RunError: If there is one.
    """
    for name, value in given.items():
        made = getattr(settings, str(name), None)
        if isinstance(value, Mapping):
            check_booleans(value, made, f"{section}{name}.")
        elif isinstance(made, bool) and not isinstance(value, bool | str) and value not in (0, 1):
            raise RunError(f"{section}{name} must be true or false, got {value}")
