import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE_ROOTS = {"dpsearch": "dpsearch", "dpsearch.configs": "configs", "dpsearch.envs": "envs"}
PRINT_FILES = "import dpsearch.configs as c, dpsearch.envs as e; print(c.__file__, e.__file__)"


@pytest.fixture(scope="module")
def setuptools_table() -> dict[str, Any]:
    table: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    return table


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """The wheel of a copy of the sources, so that nothing is built inside the checkout."""
    source = tmp_path_factory.mktemp("source")
    for name in PACKAGE_ROOTS.values():
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    build = "import sys, setuptools.build_meta as b; b.build_wheel(sys.argv[1])"
    subprocess.run([sys.executable, "-c", build, "dist"], cwd=source, check=True, capture_output=True)
    (path,) = (source / "dist").glob("*.whl")
    return zipfile.ZipFile(path)


def run_python(code: str, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], cwd=cwd, env=os.environ | environment, capture_output=True, text=True
    )


def files_of(package: str, folder: str, suffix: str) -> set[str]:
    """The files below `folder`, each as its path inside the installed package."""
    inside = package.replace(".", "/")
    return {
        f"{inside}/{file.relative_to(ROOT / folder).as_posix()}"
        for file in (ROOT / folder).rglob(f"*{suffix}")
        if "__pycache__" not in file.parts
    }


def test_every_folder_with_python_files_is_a_listed_package(setuptools_table: dict[str, Any]) -> None:
    files = set[str]().union(*(files_of(package, folder, ".py") for package, folder in PACKAGE_ROOTS.items()))
    folders = {file.rpartition("/")[0] for file in files}
    assert sorted(setuptools_table["packages"]) == sorted(folder.replace("/", ".") for folder in folders)
    assert {f"{folder}/__init__.py" for folder in folders} <= files


def test_only_envs_and_configs_stand_outside_the_package(setuptools_table: dict[str, Any]) -> None:
    outside = {package: folder for package, folder in PACKAGE_ROOTS.items() if package != folder}
    assert setuptools_table["package-dir"] == outside


def test_the_wheel_installs_dpsearch_and_nothing_else(wheel: zipfile.ZipFile) -> None:
    top_level = {name.partition("/")[0] for name in wheel.namelist()}
    assert {re.sub(r"-[\d.]+\.dist-info", ".dist-info", name) for name in top_level} == {
        "dpsearch",
        "dpsearch.dist-info",
    }


@pytest.mark.parametrize("suffix", [".py", ".yaml", "py.typed", ".sh", ".xml", ".cpp", ".hpp", ".h", "robot/LICENSE"])
def test_the_wheel_holds_every_file_that_is_needed(wheel: zipfile.ZipFile, suffix: str) -> None:
    expected = set[str]().union(*(files_of(*root, suffix) for root in PACKAGE_ROOTS.items()))
    assert {name for name in wheel.namelist() if name.startswith("dpsearch/") and name.endswith(suffix)} == expected


def test_the_wheel_works_away_from_the_checkout(wheel: zipfile.ZipFile, tmp_path: Path) -> None:
    wheel.extractall(tmp_path / "site")
    result = run_python(PRINT_FILES, cwd=tmp_path, PYTHONPATH=str(tmp_path / "site"))
    assert result.returncode == 0, result.stderr
    installed = tmp_path / "site" / "dpsearch"
    assert result.stdout.split() == [str(installed / room / "__init__.py") for room in ("configs", "envs")]


def test_the_installed_application_lists_its_settings(wheel: zipfile.ZipFile, tmp_path: Path) -> None:
    wheel.extractall(tmp_path / "site")
    code = "import sys; sys.argv = ['dpsearch-train', 'env=tiger', '--help']; from dpsearch.train import main; main()"
    result = run_python(code, cwd=tmp_path, PYTHONPATH=str(tmp_path / "site"))
    assert result.returncode == 0, result.stderr
    assert "  env.single=false\n      Whether opening a door ends the episode.\n" in result.stdout
    assert "[tiger] tmaze" in " ".join(result.stdout.split())


def test_a_bare_checkout_works_without_installation() -> None:
    forget = "import sys; sys.meta_path = [f for f in sys.meta_path if '__editable__' not in str(f)]"
    result = run_python(f"{forget}; {PRINT_FILES}", cwd=ROOT)
    assert result.returncode == 0, result.stderr
    found = [Path(file).resolve() for file in result.stdout.split()]  # through the links in dpsearch/
    assert found == [ROOT / room / "__init__.py" for room in ("configs", "envs")]


def test_a_checkout_without_links_works_too(tmp_path: Path) -> None:
    """As git makes it where the file system has no links: they are small text files then."""
    for folder in ("dpsearch", "envs", "configs"):
        shutil.copytree(ROOT / folder, tmp_path / folder, symlinks=True, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for room in ("configs", "envs"):
        link = tmp_path / "dpsearch" / room
        text = os.readlink(link)
        link.unlink()
        link.write_text(text)
    result = run_python(PRINT_FILES, cwd=tmp_path, PYTHONPATH=str(tmp_path))
    assert result.returncode == 0, result.stderr
    assert result.stdout.split() == [str(tmp_path / room / "__init__.py") for room in ("configs", "envs")]


@pytest.mark.parametrize("name", ["envs", "configs"])
def test_a_plain_import_is_refused_and_names_the_right_one(name: str) -> None:
    result = run_python(f"import {name}", cwd=ROOT)
    assert result.returncode != 0
    last_line = result.stderr.splitlines()[-1]
    assert last_line.startswith("ImportError: ")
    assert f"dpsearch.{name}" in last_line


def test_continuous_integration_runs_the_commands_of_the_readme() -> None:
    blocks = re.findall(r"^```(?:bash|sh|shell)\n(.*?)^```", (ROOT / "README.md").read_text(), re.M | re.S)
    lines = [line for block in blocks for line in block.splitlines()]
    commands = [line for line in lines if line.startswith("pip install -e ")]
    assert len(commands) == 2
    script = (ROOT / ".ci" / "run").read_text().splitlines()
    assert [line for line in script if line.startswith("(pip")] == [f"({command})" for command in commands]


def test_the_citation_names_the_current_version() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert f"version: {version}" in (ROOT / "CITATION.cff").read_text().splitlines()
