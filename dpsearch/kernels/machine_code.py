"""Machine code on disk, under the hash of all the sources that it was compiled from.

Numba's own cache looks at the file of a function alone. A function that it inlines, and a constant that it uses, may
stand in another file: after a change there Numba would go on with the old code. Here a version of a kernel is found
only if nothing has changed in its own file or in any file of the project that it imports, directly or not.

A file is written beside its place and renamed, and no two versions share one, so several first runs at once are safe.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import platform
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from importlib.metadata import version
from importlib.util import resolve_name
from pathlib import Path
from types import ModuleType
from typing import Any

from numba.core.compiler import CompileResult
from numba.core.serialize import dumps

_IMPORT = re.compile(r"^[ \t]*(?:from[ \t]+([\w.]+)[ \t]+import[ \t]+(\([^)]*\)|[^\n]*)|import[ \t]+([^\n]*))", re.M)
_PACKAGE = Path(__file__).parents[1]
_DIGEST = hashlib.sha256().digest_size


listeners: list[Callable[[str], object]] = []
"""Functions that are called with the name of each kernel about to be compiled."""


class MachineCode:
    """The versions of one kernel on disk: what a Numba dispatcher asks for before it compiles, and gives after.

    Args:
        function: The kernel, as Python has it.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function

    def load_overload(self, signature: Any, context: Any) -> CompileResult | None:
        """The version for a signature; None if it is not there, or damaged."""
        context.refresh()
        found = self._load(self._file_name(signature, context.codegen()), context) if self._has_source else None
        if found is None:
            for listener in listeners:
                listener(self._function.__qualname__)
        return found

    @property
    def _has_source(self) -> bool:
        """Whether the kernel stands in a file; else nobody could tell whether it has changed."""
        return _source(sys.modules.get(self._function.__module__)) is not None

    def _load(self, name: str, context: Any) -> CompileResult | None:
        for folder in folders():
            try:
                digest, code = _split((folder / name).read_bytes())
            except OSError:
                continue
            if hashlib.sha256(code).digest() == digest:
                found: CompileResult = CompileResult._rebuild(context, *pickle.loads(code))
                return found
        return None

    def save_overload(self, signature: Any, result: CompileResult) -> None:
        """Keep a version, in the first folder that can be written to, and delete what older sources led to."""
        if not self._has_source:
            return
        code = dumps(result._reduce())
        name = self._file_name(signature, result.codegen)
        for folder in folders():
            try:
                folder.mkdir(parents=True, exist_ok=True)
                handle, part = tempfile.mkstemp(prefix=f".{name}", dir=folder)
                with open(handle, "wb") as file:
                    file.write(hashlib.sha256(code).digest() + code)
                os.replace(part, folder / name)
            except OSError:
                continue
            for other in folder.glob(f"{name.rpartition('-')[0]}-*.code"):
                if other.name != name:
                    other.unlink(missing_ok=True)
            return

    def _file_name(self, signature: Any, codegen: Any) -> str:
        """File name of a version: the kernel, hashes of signature, processor and software, and of all sources."""
        software = (platform.python_version(), version("numba"), version("llvmlite"), codegen.magic_tuple())
        asked_for = hashlib.sha256(repr((str(signature), software)).encode()).hexdigest()[:16]
        sources = sources_hash(self._function.__module__)[:16]
        return f"{self._function.__module__}.{self._function.__qualname__}-{asked_for}-{sources}.code".replace("<", "")


@cache
def sources_hash(module: str) -> str:
    """Hash of the source of a module that is imported, and of all that it imports from the same project."""
    digest = hashlib.sha256()
    for path in sorted(_reachable(module)):
        digest.update(path.read_bytes())
        digest.update(b"\0")
    return digest.hexdigest()


def _reachable(module: str) -> set[Path]:
    found: dict[str, Path] = {}
    todo = [module]
    while todo:
        name = todo.pop()
        source = _source(sys.modules.get(name))
        if name not in found and source is not None:
            found[name] = source
            todo += _imported(source.read_text(), name)
    return set(found.values())


def _imported(code: str, module: str) -> Iterator[str]:
    """The modules of the same project, or of this package, that a module's code may import."""
    projects = {module.partition(".")[0], __name__.partition(".")[0]}
    package = sys.modules[module].__package__ or ""
    for base, names, modules in _IMPORT.findall(code):
        home = resolve_name(base, package) if base.startswith(".") else base
        inside = [f"{home}.{name}" for name in re.findall(r"\w+", names)]
        for name in [home, *inside] if home else re.findall(r"[\w.]+", modules):
            if name.partition(".")[0] in projects:
                yield name


def _source(module: ModuleType | None) -> Path | None:
    file = getattr(module, "__file__", None)
    return Path(file) if file is not None and file.endswith(".py") else None


@cache
def folders() -> list[Path]:
    """Folders for machine code, in order: beside the package, or where that cannot be written, this user's cache.

    ``NUMBA_CACHE_DIR`` names another place than the first. Where nothing can be written, each process compiles anew,
    which a line says.
    """
    named = os.environ.get("NUMBA_CACHE_DIR")
    mine = hashlib.sha256(str(_PACKAGE).encode()).hexdigest()[:16]  # of this checkout or installation
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    found = [
        Path(named) / f"dpsearch-{mine}" if named else _PACKAGE / "__pycache__" / "kernels",
        home / "dpsearch" / mine,
    ]
    if not any(_writable(folder) for folder in found):
        print("compiled code can be kept nowhere: set NUMBA_CACHE_DIR to a folder that can be written", file=sys.stderr)
    return found


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK)


def _split(content: bytes) -> tuple[bytes, bytes]:
    return content[:_DIGEST], content[_DIGEST:]
