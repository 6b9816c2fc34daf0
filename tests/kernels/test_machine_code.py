"""Compiled code is found again by later processes, and only if nothing that it was compiled from has changed."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

KERNEL = """
import numpy as np
from dpsearch.kernels.on_demand import on_demand
from project.constants import FACTOR
from project.inlined import (
    shifted,
)

@on_demand()
def scaled(x):
    return FACTOR * shifted(x)

print(scaled(np.float64(2.0)))
"""
INLINED = """
from numba import njit
from . import deeper

@njit(inline="always")
def shifted(x):
    return x + deeper.SHIFT
"""


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project of one kernel and three modules that it is compiled from."""
    folder = tmp_path / "project"
    folder.mkdir()
    (folder / "__init__.py").touch()
    (folder / "kernel.py").write_text(KERNEL)
    (folder / "constants.py").write_text("FACTOR = 10.0\n")
    (folder / "inlined.py").write_text(INLINED)
    (folder / "deeper.py").write_text("SHIFT = 1.0\n")
    return folder


def begin(project: Path, code: str = "import project.kernel", **environment: str) -> subprocess.Popen[str]:
    paths = [str(project.parent), str(Path(__file__).parents[2])]
    own = {"PYTHONPATH": os.pathsep.join(paths), "NUMBA_CACHE_DIR": str(project.parent / "cache")}
    return subprocess.Popen(
        [sys.executable, "-c", code],
        env=os.environ | own | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def run(project: Path, **environment: str) -> tuple[float, str]:
    """What the kernel gives in a process of its own, and what that process says on stderr."""
    process = begin(project, **environment)
    out, err = process.communicate()
    assert process.returncode == 0, err
    return float(out), err


def files(project: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in (project.parent / "cache").rglob("*.code")}


def test_a_second_process_compiles_nothing(project: Path) -> None:
    assert run(project) == (30.0, "")
    compiled = files(project)
    assert len(compiled) == 1
    assert run(project) == (30.0, "")
    assert files(project) == compiled


@pytest.mark.parametrize(
    ("module", "code", "result"),
    [
        ("kernel", KERNEL.replace("FACTOR *", "2.0 * FACTOR *"), 60.0),
        ("constants", "FACTOR = 20.0\n", 60.0),
        ("inlined", INLINED.replace("x + ", "x - "), 10.0),
        ("deeper", "SHIFT = 2.0\n", 40.0),
    ],
)
def test_a_change_in_anything_it_was_compiled_from_is_seen(
    project: Path, module: str, code: str, result: float
) -> None:
    run(project)
    path = project / f"{module}.py"
    times = path.stat()
    path.write_text(code)
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))  # even if the clock shows none
    assert run(project) == (result, "")
    assert len(files(project)) == 1  # what nobody can use any more is deleted


def test_a_change_elsewhere_costs_nothing(project: Path) -> None:
    run(project)
    compiled = files(project)
    (project / "other.py").write_text("FACTOR = 20.0\n")
    assert run(project)[0] == 30.0
    assert files(project) == compiled


def test_a_damaged_file_is_not_used(project: Path) -> None:
    run(project)
    (path,) = (project.parent / "cache").rglob("*.code")
    content = bytearray(path.read_bytes())
    for damaged in (content[:-100], content[: len(content) // 2], b"", bytes([content[0] ^ 1]) + content[1:]):
        path.write_bytes(damaged)
        assert run(project) == (30.0, "")
    compiled = files(project)
    assert run(project) == (30.0, "")
    assert files(project) == compiled  # whole again


def test_several_first_runs_at_once_are_safe(project: Path) -> None:
    processes = [begin(project) for _ in range(4)]
    assert [float(process.communicate()[0]) for process in processes] == [30.0] * 4
    assert len(files(project)) == 1
    assert not list((project.parent / "cache").rglob(".*"))


def test_where_nothing_can_be_written_a_line_says_what_helps(project: Path) -> None:
    (project.parent / "file").touch()
    nowhere = str(project.parent / "file" / "folder")
    result, said = run(project, NUMBA_CACHE_DIR=nowhere, XDG_CACHE_HOME=nowhere)
    assert result == 30.0
    assert said == "compiled code can be kept nowhere: set NUMBA_CACHE_DIR to a folder that can be written\n"


def test_where_the_installation_cannot_be_written_this_users_cache_is_used(project: Path) -> None:
    (project.parent / "file").touch()
    nowhere = str(project.parent / "file" / "folder")
    assert run(project, NUMBA_CACHE_DIR=nowhere, XDG_CACHE_HOME=str(project.parent / "cache")) == (30.0, "")
    assert len(files(project)) == 1


def test_who_wants_to_know_hears_what_is_compiled(project: Path) -> None:
    code = "from dpsearch.kernels import machine_code as m; m.listeners.append(print); import project.kernel"
    for said in ("scaled\n30.0\n", "30.0\n"):
        assert begin(project, code=code).communicate()[0] == said


def test_kernels_are_compiled_where_numba_is_told_not_to(project: Path) -> None:
    result, said = run(project, NUMBA_DISABLE_JIT="1")
    assert result == 30.0
    assert "NUMBA_DISABLE_JIT is ignored" in said
