"""The options of a class, read from its signature and its docstring: configurations and ``--help`` repeat neither."""

from __future__ import annotations

import copy
import dataclasses
import inspect
import os
import re
import types
import typing
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

REQUIRED: Any = inspect.Parameter.empty
"""The default of an option that must be given."""
MEANING = "meaning"  # key in the metadata of a dataclass's field

_PRIMITIVE = (bool, int, float, str)
_ENTRY = re.compile(r" {4}\*{0,2}(\w+)(?: \(.*?\))?: *(.*)")  # in a section of a docstring
_MARKUP = re.compile(r"``(.+?)``|:\w+:`~?(.+?)`")


@dataclass(frozen=True)
class Option:
    """One option of a class.

    Attributes:
        name: The argument's name.
        type: The argument's type, as far as a configuration can check it: a primitive, a list of primitives, either of
            them or None; else ``Any``.
        default: The argument's default, with lists for tuples; ``REQUIRED`` if there is none.
        meaning: The docstring's sentence about it.
        is_path: Whether it names a file.
    """

    name: str
    type: Any
    default: Any
    meaning: str
    is_path: bool


def options_of(kind: type, without: Collection[str] = ()) -> list[Option]:
    """The arguments that a class takes by name, its own first.

    They stand in the signature of its ``make_task``, or else of its ``__init__``. Where that passes ``**others`` on,
    those of the class it inherits from follow.

    Args:
        kind: The class.
        without: Arguments that are no options.
    """
    found: dict[str, Option] = {}
    meant = meanings(kind)
    for cls in kind.__mro__:
        function = next((getattr(cls, name) for name in ("make_task", "__init__") if name in vars(cls)), None)
        if function is None:
            continue
        hints = typing.get_type_hints(function)
        arguments = list(inspect.signature(function).parameters.values())
        for argument in arguments:
            name, hint = argument.name, hints.get(argument.name, Any)
            by_name = argument.kind in (argument.POSITIONAL_OR_KEYWORD, argument.KEYWORD_ONLY)
            if by_name and name not in {"self", *found, *without}:
                option = Option(name, _checkable(hint), _listed(argument.default), meant.get(name, ""), _is_path(hint))
                found[name] = option
        if not any(argument.kind is argument.VAR_KEYWORD for argument in arguments):
            break
    return list(found.values())


def dataclass_of(
    name: str, options: Iterable[Option], base: type, *, missing: Any = None, namespace: Mapping[str, Any] | None = None
) -> type[Any]:
    """A dataclass with a field for each option.

    Args:
        name: Its name.
        options: The options.
        base: The dataclass whose fields come before.
        missing: Default of the fields whose option must be given.
        namespace: Other attributes of the class.
    """
    fields = [
        (
            option.name,
            option.type,
            dataclasses.field(
                default_factory=partial(copy.copy, missing if option.default is REQUIRED else option.default),
                metadata={MEANING: option.meaning},
            ),
        )
        for option in options
    ]
    module = {"__module__": base.__module__}
    return dataclasses.make_dataclass(name, fields, bases=(base,), namespace={**module, **(namespace or {})})


def meanings(kind: type) -> dict[str, str]:
    """The meaning of each argument and attribute of a class, from its own docstring or those it inherits from.

    The metadata of a dataclass's fields come before the docstring's section ``Args``, and that before ``Attributes``.
    """
    found: dict[str, str] = {}
    for cls in reversed(kind.__mro__):
        sections = docstring_sections(vars(cls).get("__doc__") or "")
        found |= {**sections.get("Attributes", {}), **sections.get("Args", {})}
    if dataclasses.is_dataclass(kind):
        found |= {f.name: f.metadata[MEANING] for f in dataclasses.fields(kind) if MEANING in f.metadata}
    return found


def docstring_sections(text: str) -> dict[str, dict[str, str]]:
    """The sections of a docstring in Google's style that describe something by name, without markup.

    Args:
        text: The docstring.

    Returns:
        For each section's heading, what is described, and how.
    """
    sections: dict[str, dict[str, str]] = {}
    section, name = None, ""
    for line in inspect.cleandoc(text).splitlines():
        if line and not line.startswith(" "):
            section = sections.setdefault(line[:-1], {}) if re.fullmatch(r"\w+:", line) else None
        elif section is not None and (entry := _ENTRY.fullmatch(line)):
            name, section[entry[1]] = entry[1], _plain(entry[2])
        elif section and line:
            section[name] = f"{section[name]} {_plain(line)}"
    return sections


def _plain(line: str) -> str:
    """A line of a docstring without indentation and markup."""
    return _MARKUP.sub(lambda found: found[1] or found[2], line.strip())


def _checkable(hint: Any) -> Any:
    """A type hint in a form that configurations can check."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if hint in _PRIMITIVE:
        return hint
    if origin in (typing.Union, types.UnionType):
        kinds = {_checkable(argument) for argument in arguments if argument is not type(None)}
        kind = kinds.pop() if len(kinds) == 1 else Any
        return kind | None if kind is not Any and len(arguments) > 1 and type(None) in arguments else kind
    if origin in (list, Sequence) and arguments[0] in _PRIMITIVE:
        return list[arguments[0]]  # type: ignore[valid-type]  # known when the program runs
    return str if _is_path(hint) else Any


def _is_path(hint: Any) -> bool:
    """Whether a type hint allows a path, which is a string in a configuration."""
    kind = typing.get_origin(hint) or hint
    if kind in (typing.Union, types.UnionType):
        return any(_is_path(argument) for argument in typing.get_args(hint))
    return isinstance(kind, type) and issubclass(kind, os.PathLike)


def _listed(value: Any) -> Any:
    """A value with lists for tuples, as configurations have them."""
    return [_listed(item) for item in value] if isinstance(value, tuple | list) else value
