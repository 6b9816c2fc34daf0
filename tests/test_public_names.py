from importlib import import_module

import pytest

import dpsearch
from tests.support.public_names import homes


def test_type_checkers_and_the_interpreter_find_the_same_names() -> None:
    assert set(dpsearch.__all__) == {*homes(), "__version__"}
    assert set(dpsearch.__all__) <= set(dir(dpsearch))


@pytest.mark.parametrize(("name", "home"), homes().items())
def test_a_public_name_is_the_object_of_its_module(name: str, home: str) -> None:
    assert getattr(dpsearch, name) is getattr(import_module(home), name)


def test_the_version_is_a_string() -> None:
    assert isinstance(dpsearch.__version__, str)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'RPC'"):
        dpsearch.RPC  # noqa: B018
