"""The house has floors, and no import may climb."""

import ast
import importlib.util
import subprocess
import sys
import textwrap
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.support.public_names import homes

ROOT = Path(__file__).parents[1]
HOMES = homes()

# From the ground up. A room imports from the floors below it and from itself, not from its neighbours;
# on the top floor, where the applications are, all doors are open.
FLOORS = (
    {"kernels", "files", "errors", "options", "renamed", "configs"},
    {"env_kit"},
    {"pomdp"},
    {"envs", "policies", "search"},
    {"rollout"},
    {"algos"},
    {"runs", "report"},
    {"config", "help", "train", "evaluate", "scripts"},
)
FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in rooms}
TOP = len(FLOORS) - 1


def sources() -> Iterator[tuple[str, Path]]:
    """Full module name and path of every source file, except the table of names in `dpsearch/__init__.py`."""
    for folder in ("dpsearch", "envs", "configs", "scripts"):
        prefix = "dpsearch." if folder in {"envs", "configs"} else ""
        for path in sorted((ROOT / folder).rglob("*.py")):
            module = prefix + ".".join(path.relative_to(ROOT).with_suffix("").parts)
            if module != "dpsearch.__init__":
                yield module, path
    yield "train", ROOT / "train.py"


def room_of(module: str) -> str:
    """The room that a module of the project, named in full, belongs to."""
    first, *rest = module.split(".")
    if first != "dpsearch":
        return first
    if not rest:
        return "train"  # `import dpsearch` offers the whole house
    return rest[0]


def imported_modules(code: str, module: str, also_submodules: bool = False) -> Iterator[tuple[int, str]]:
    """Line and full name of everything of the project that the code imports, wherever it does so.

    What is imported from a package may be a module in it: `also_submodules` names each as if it were one.
    """
    for node in ast.walk(ast.parse(code)):
        if not isinstance(node, ast.stmt | ast.expr):
            continue
        names: list[str] = []
        match node:
            case ast.Import():
                names = [alias.name for alias in node.names]
            case ast.ImportFrom(module=base, level=level):
                package = module.rpartition(".")[0]
                source = importlib.util.resolve_name("." * level + (base or ""), package)
                names = [f"{source}.{alias.name}" for alias in node.names] if also_submodules else [source]
                if source == "dpsearch":  # a room, or a public name: count the module it comes from
                    public = [alias.name for alias in node.names if alias.name != "__version__"]
                    names = [HOMES.get(name, f"dpsearch.{name}") for name in public]
            case ast.Call(
                func=ast.Name(id="import_module") | ast.Attribute(attr="import_module"),
                args=[ast.Constant(value=str(name)), *_],
            ):
                names = [name]
        for name in names:
            if name.split(".")[0] in {"dpsearch", "scripts", "tests", "train"}:
                yield node.lineno, name


def may_import(here: str, there: str) -> bool:
    above, below = FLOOR[here], FLOOR.get(there, TOP + 1)
    return here == there or below < above or below == above == TOP


def climbs(code: str, module: str) -> list[str]:
    """The imports that the module may not have."""
    here = room_of(module)
    found = imported_modules(code, module)
    return [f"line {line}: {name}" for line, name in found if not may_import(here, room_of(name))]


def test_every_room_has_a_floor() -> None:
    assert {room_of(module) for module, _ in sources()} <= FLOOR.keys()


@pytest.mark.parametrize("room", sorted(FLOOR))
def test_no_import_climbs(room: str) -> None:
    files = [(module, path) for module, path in sources() if room_of(module) == room]
    found = {str(path.relative_to(ROOT)): climbs(path.read_text(), module) for module, path in files}
    assert not {path: lines for path, lines in found.items() if lines}


@pytest.mark.parametrize(
    "code",
    [
        "from dpsearch.algos.rpg.rpg import RPG",
        "import dpsearch.algos as algos",
        "from dpsearch import algos",
        "from dpsearch import RPG",
        "from ..algos import rpg",
        "from .. import algos",
        "import dpsearch",
        "def later():\n    import dpsearch.runs",
        "if TYPE_CHECKING:\n    from dpsearch.train import main",
        "importlib.import_module('dpsearch.runs')",
        "from scripts import benchmark",
        "import tests.conftest",
    ],
)
def test_an_import_that_climbs_is_found_in_every_form(code: str) -> None:
    assert len(climbs(code, "dpsearch.rollout.gym_engine")) == 1


@pytest.mark.parametrize(
    "code",
    [
        "import numpy, torch",
        "from dpsearch import __version__, envs",
        "from dpsearch.kernels.lanes import LANES",
        "from dpsearch.rollout.episodes import Episodes",
        "from . import episodes",
        "from ..policies import RecurrentPolicy",
    ],
)
def test_an_import_that_descends_is_allowed(code: str) -> None:
    assert climbs(code, "dpsearch.rollout.gym_engine") == []


def test_neighbours_keep_apart_except_on_the_top_floor() -> None:
    assert climbs("import dpsearch.policies", "dpsearch.search.nes")
    assert not climbs("import dpsearch.train", "scripts.reproduce")


def circles(arrows: dict[str, set[str]]) -> list[str]:
    """Modules that import one another in a circle, each circle as text; found by walking down from every module."""
    found, done = [], set[str]()

    def walk(module: str, path: list[str]) -> None:
        if module in path:
            found.append(" -> ".join([*path[path.index(module) :], module]))
        elif module not in done:
            for other in sorted(arrows.get(module, ())):
                walk(other, [*path, module])
            done.add(module)

    for module in sorted(arrows):
        walk(module, [])
    return found


def arrows_between(modules: dict[str, str]) -> dict[str, set[str]]:
    """Which of these modules, each with its code, imports which; a package's own names count as its `__init__`."""

    def target(name: str) -> str | None:
        for candidate in (name, f"{name}.__init__"):
            if candidate in modules:
                return candidate
        parent = name.rpartition(".")[0]
        return target(parent) if parent else None

    found: dict[str, set[str]] = {}
    for module, code in modules.items():
        names = {name for _, name in imported_modules(code, module, also_submodules=True)}
        found[module] = {there for name in names if (there := target(name)) is not None and there != module}
    return found


def test_no_imports_run_in_a_circle() -> None:
    assert circles(arrows_between({module: path.read_text() for module, path in sources()})) == []


@pytest.mark.parametrize(
    "back",
    [
        "import dpsearch.a",
        "from dpsearch import a",
        "from . import a",
        "from dpsearch.a import X",
        "def later():\n    from dpsearch.a import X",
        "if TYPE_CHECKING:\n    from dpsearch.a import X",
    ],
)
def test_a_circle_is_found_in_every_form(back: str) -> None:
    modules = {"dpsearch.a": "from dpsearch.b import Y", "dpsearch.b": "import dpsearch.c", "dpsearch.c": back}
    assert len(circles(arrows_between(modules))) == 1
    assert circles(arrows_between({**modules, "dpsearch.c": "import numpy"})) == []


def test_only_environments_that_are_made_import_the_tasks() -> None:
    """Simulators of one's own need none of ours."""
    ours = [module for module, _ in sources() if module.startswith("dpsearch.") and room_of(module) != "envs"]
    code = f"""
        import sys, importlib
        for module in {ours}:
            importlib.import_module(module.removesuffix(".__init__"))
            assert "dpsearch.envs" not in sys.modules, module
        """
    subprocess.run([sys.executable, "-c", textwrap.dedent(code)], cwd=ROOT, check=True)


@pytest.mark.parametrize(
    ("module", "forbidden"),
    [("dpsearch", {"torch", "numba", "numpy", "gymnasium"}), ("dpsearch.envs", {"torch"})],
)
def test_importing_does_not_bring_what_is_not_needed(module: str, forbidden: set[str]) -> None:
    code = f"import sys, {module}; print(*sys.modules)"
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True, text=True)
    assert not forbidden & set(result.stdout.split())
