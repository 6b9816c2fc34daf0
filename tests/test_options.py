from collections.abc import Sequence
from dataclasses import dataclass, fields
from os import PathLike
from typing import Any

import pytest
from omegaconf import OmegaConf

from dpsearch.options import REQUIRED, dataclass_of, docstring_sections, meanings, options_of


class Base:
    """A class.

    Args:
        inherited: Passed on,
            on two lines.
        replaced: By the base.
    """

    def __init__(self, inherited: int = 1, *, replaced: str = "base") -> None: ...


class Derived(Base):
    """Another.

    Args:
        needed (int): Something with ``markup`` and a :class:`Base`: and a colon.
        replaced: By itself.
        **others: See ``Base``.

    Attributes:
        needed: Hidden by the argument.
        shown: An attribute.

    Raises:
        ValueError: Never.
    """

    def __init__(self, needed: int, replaced: str = "own", **others: Any) -> None: ...


class Wide:
    """Types of many kinds."""

    def __init__(
        self,
        numbers: Sequence[float] = (1.0, 2.0),
        maybe: int | None = None,
        maybe_many: list[str] | None = None,
        either: int | str = 3,
        nested: Sequence[Any] = ((1, 2), 3),
        file: str | PathLike[str] | None = None,
        free: Any = None,
        **others: Any,
    ) -> None: ...


def test_options_are_the_arguments_of_a_class_and_of_those_that_it_passes_others_on_to() -> None:
    found = {option.name: option for option in options_of(Derived)}
    assert list(found) == ["needed", "replaced", "inherited"]
    assert found["needed"].default is REQUIRED
    assert (found["replaced"].default, found["inherited"].default) == ("own", 1)
    assert [option.name for option in options_of(Base)] == ["inherited", "replaced"]
    assert [option.name for option in options_of(Derived, without={"needed"})] == ["replaced", "inherited"]


def test_meanings_are_the_docstring_s_without_markup_and_the_nearest_class_s() -> None:
    assert meanings(Derived) == {
        "inherited": "Passed on, on two lines.",
        "replaced": "By itself.",
        "others": "See Base.",
        "needed": "Something with markup and a Base: and a colon.",
        "shown": "An attribute.",
    }


def test_a_section_ends_where_the_next_begins() -> None:
    sections = docstring_sections(Derived.__doc__ or "")
    assert list(sections) == ["Args", "Attributes", "Raises"]
    assert list(sections["Attributes"]) == ["needed", "shown"]
    assert docstring_sections("") == {}


def test_types_are_kept_as_far_as_a_configuration_can_check_them() -> None:
    found = {option.name: option for option in options_of(Wide)}
    assert {name: option.type for name, option in found.items()} == {
        "numbers": list[float],
        "maybe": int | None,
        "maybe_many": list[str] | None,
        "either": Any,
        "nested": Any,
        "file": str | None,
        "free": Any,
    }
    assert (found["numbers"].default, found["nested"].default) == ([1.0, 2.0], [[1, 2], 3])
    assert [name for name, option in found.items() if option.is_path] == ["file"]


@dataclass
class Settings:
    """Settings.

    Attributes:
        first: Comes first.
    """

    first: int = 0


def test_options_become_the_fields_of_a_dataclass_that_omegaconf_checks() -> None:
    kind = dataclass_of("Both", options_of(Wide), Settings)
    assert [setting.name for setting in fields(kind)][:2] == ["first", "numbers"]
    first, second = kind(), kind()
    first.numbers.append(3.0)
    assert second.numbers == [1.0, 2.0]
    node = OmegaConf.structured(kind)
    node.maybe_many = ["a"]
    with pytest.raises(ValueError, match="could not be converted"):
        node.numbers = ["a"]
    assert meanings(dataclass_of("Other", options_of(Derived), Settings))["replaced"] == "By itself."
