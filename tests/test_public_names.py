import ast
from importlib import import_module
from pathlib import Path

import pytest

import dpsearch


def test_type_checkers_and_the_interpreter_find_the_same_names() -> None:
    tree = ast.parse(Path(dpsearch.__file__).read_text())
    (block,) = (node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    assert {alias.name: node.module for node in imports for alias in node.names} == dpsearch._HOMES
    assert set(dpsearch.__all__) == {*dpsearch._HOMES, "__version__"}
    assert set(dpsearch.__all__) <= set(dir(dpsearch))


@pytest.mark.parametrize(("name", "home"), dpsearch._HOMES.items())
def test_a_public_name_is_the_object_of_its_module(name: str, home: str) -> None:
    assert getattr(dpsearch, name) is getattr(import_module(home), name)


def test_the_version_is_a_string() -> None:
    assert isinstance(dpsearch.__version__, str)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'RPC'"):
        dpsearch.RPC  # noqa: B018
