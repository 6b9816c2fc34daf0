"""Arguments of the searches: converted to Python's own numbers, or refused in one line that begins with their name."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterable
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

CALLED = {"popsize": "population", "maxfevals": "max_evaluations", "ftarget": "target", "sigma": "sigma0"}
"""Names that other packages give to arguments -> their names here."""
SHOWN = 80  # characters of a value that a message shows


def whole(name: str, value: Any, least: int, below: int | None = None) -> int:
    """A whole number as an int; NumPy's integers and whole floats are converted.

    Raises:
        ValueError: If it is something else (a bool is), less than ``least``, or not less than ``below``.
    """
    number = _real(value)
    if number is None or not math.isfinite(number) or number != int(number):
        fits = False
    else:
        fits = least <= int(value) and (below is None or int(value) < below)
    if not fits:
        span = f", at least {least}" if below is None else f" in [{least}, 2**{below.bit_length() - 1})"
        raise ValueError(f"{name} must be a whole number{span}, got {shown(value)}")
    return int(value)


def number(
    name: str, value: Any, accepted: str = "a number", least: float = -math.inf, below: float | None = None
) -> float:
    """A number that is not NaN, as a float.

    Raises:
        ValueError: If it is no number, less than ``least`` or not less than ``below``; the message says what is
            ``accepted``.
    """
    converted = _real(value)
    if converted is None or not converted >= least or (below is not None and not converted < below):
        raise ValueError(f"{name} must be {accepted}, got {shown(value)}")
    return converted


def positive(name: str, value: Any) -> float:
    """A positive finite number, as a float; a ValueError that begins with its name if it is none."""
    converted = _real(value)
    if converted is None or not 0.0 < converted < math.inf:
        raise ValueError(f"{name} must be positive and finite, got {shown(value)}")
    return converted


def fraction(name: str, value: Any, *, one: bool = True) -> float:
    """A number in (0, 1], or without ``one`` in (0, 1), as a float; else a ValueError that begins with its name."""
    converted = _real(value)
    if converted is None or not 0.0 < converted <= 1.0 or (converted == 1.0 and not one):
        raise ValueError(f"{name} must be in (0, 1{']' if one else ')'}, got {shown(value)}")
    return converted


def one_of(name: str, value: Any, choices: Iterable[str]) -> str:
    """One of the names on offer; a ValueError that lists them if it is none."""
    if not isinstance(value, str) or value not in choices:
        raise ValueError(f"{name} must be one of {', '.join(choices)}, got {shown(value)}")
    return value


def flag(name: str, value: Any) -> bool:
    """True or False, NumPy's too; a ValueError that begins with its name if it is neither."""
    if not isinstance(value, bool | np.bool_):
        raise ValueError(f"{name} must be True or False, got {shown(value)}")
    return bool(value)


def array(name: str, value: ArrayLike, accepted: str) -> NDArray[np.float64]:
    """A new array of floats; a ValueError that says what is ``accepted`` if the value holds anything but numbers."""
    try:
        if not np.iscomplexobj(value):
            return np.array(value, np.float64)
    except (TypeError, ValueError, RuntimeError):
        pass
    raise ValueError(f"{name} must be {accepted}, got {shown(value)}")


def shown(value: Any) -> str:
    """A value as it is written, on one line and not too long."""
    text = " ".join(repr(value).split())
    return text if len(text) <= SHOWN else f"{text[: SHOWN - 3]}..."


def refuse_unknown(owner: str, given: Iterable[str], accepted: Iterable[str]) -> None:
    """Raise a TypeError that names the first unknown argument, and those that there are."""
    for name in given:
        if name not in accepted:
            hint = f" (here it is called {CALLED[name]})" if name in CALLED else ""
            raise TypeError(f"{name} is not an argument of {owner}{hint}; it accepts {', '.join(accepted)}")


def accepted_by(kind: type) -> list[str]:
    """The names of a class's arguments: its constructor's own, and those of the base classes that it passes on to."""
    names: dict[str, None] = {}
    for base in kind.__mro__:
        if "__init__" not in base.__dict__:
            continue
        parameters = list(inspect.signature(base.__dict__["__init__"]).parameters.values())[1:]
        names |= {p.name: None for p in parameters if p.kind is not p.VAR_KEYWORD}
        if not any(p.kind is p.VAR_KEYWORD for p in parameters):
            break
    return list(names)


def _real(value: Any) -> float | None:
    """A real number as a float: NumPy's too, and arrays without axes; None if it is none."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value.item()
    if isinstance(value, bool | np.bool_) or not isinstance(value, Real):
        return None
    try:
        return float(value)
    except OverflowError:
        return math.inf
