"""The names that ``dpsearch`` offers, and the modules that they come from, as type checkers see them."""

from __future__ import annotations

import ast
from pathlib import Path

import dpsearch


def homes() -> dict[str, str]:
    """The module of each public name but the version."""
    tree = ast.parse(Path(dpsearch.__file__).read_text())
    (block,) = (node for node in tree.body if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING")
    imports = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}
