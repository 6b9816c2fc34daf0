import json
from pathlib import Path
from typing import Any, cast

import pytest

from dpsearch.report.tables import SUCCESS_RATE
from scripts import reproduce
from tests.support.runs_here import make_runs_here

QUICK = ["--jobs", "1", "--runs", "2", "--dimensions", "2"]


@pytest.fixture(autouse=True)
def made(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Runs are made in this process; the tasks and methods of all that were made."""
    return make_runs_here(monkeypatch)


def content(out: Path, name: str) -> dict[str, Any]:
    return cast(dict[str, Any], json.loads((out / f"{name}.json").read_text()))


def test_a_tiny_figure_7_1_is_computed_and_written(tmp_path: Path) -> None:
    reproduce.main(["fig_7_1", *QUICK, "--functions", "Sphere,Cigar", "--out", str(tmp_path)])
    found = content(tmp_path, "fig_7_1")
    rows = {(row["task"], row["method"], row["metric"]): row for row in found["rows"]}
    assert len(rows) == 2 * 3 * 2
    needed = {method: rows["Cigar, d = 2", method, "evaluations"]["mean"] for method in ("NES", "FEM", "CMA-ES")}
    assert 100 < min(needed.values()) <= max(needed.values()) < 10_000
    assert [curve["method"] for curve in found["curves"]] == 2 * ["NES", "FEM", "CMA-ES"]
    for curve in found["curves"]:
        bands = zip(curve["low"], curve["median"], curve["high"], strict=True)
        assert all(low <= median <= high for low, median, high in bands)
        assert curve["median"] == sorted(curve["median"], reverse=True)
        assert curve["median"][-1] < 1e-8
        assert curve["reached"] == pytest.approx(rows[curve["task"], curve["method"], "evaluations"]["mean"], rel=0.5)
    page = (tmp_path / "fig_7_1.md").read_text()
    assert "| method | Sphere | Cigar |" in page
    assert "CMA-ES converges faster than FEM and NES on Sphere" in page
    assert found["command"] in page
    assert (tmp_path / "fig_7_1.png").read_bytes().startswith(b"\x89PNG")


def test_figures_share_their_runs(tmp_path: Path, made: list[str]) -> None:
    options = [*QUICK, "--functions", "Sphere", "--out", str(tmp_path)]
    reproduce.main(["fig_4_5", *options])
    assert made == ["Sphere, d = 2: nes"] * 2
    reproduce.main(["fig_7_1", *options])
    assert made[2:] == ["Sphere, d = 2: fem"] * 2 + ["Sphere, d = 2: cmaes"] * 2
    reproduce.main(["fig_5_1", *options])
    reproduce.main(["functions", *options, "--methods", "cmaes,nes"])
    assert len(made) == 6
    logs = [path.name for path in tmp_path.glob("*.jsonl")]
    assert logs == ["functions_unimodal.runs.jsonl"]
    assert len((tmp_path / logs[0]).read_text().splitlines()) == 3


def test_multimodal_figures_vary_distance_and_dimension(tmp_path: Path, made: list[str]) -> None:
    options = ["--jobs", "1", "--runs", "2", "--dimensions", "2,3", "--distances", "0.1,1", "--functions", "Griewank"]
    reproduce.main(["fig_4_6", *options, "--out", str(tmp_path)])
    places = ["d = 2, distance 0.1", "d = 2, distance 1", "d = 3, distance 1"]
    assert made == [f"Griewank, {place}: nes" for place in places for _ in range(2)]
    rates = [row for row in content(tmp_path, "fig_4_6")["rows"] if row["metric"] == SUCCESS_RATE]
    assert [row["mean"] for row in rates] == [1.0, 1.0, 1.0]
    page = (tmp_path / "fig_4_6.md").read_text()
    assert f"| function | {' | '.join(places)} |" in page
    assert "| Griewank | 100% [34.2%, 100%] |" in page
    assert (tmp_path / "fig_4_6.png").exists()


def test_others_and_the_savings_of_importance_mixing_stand_beside_ours(tmp_path: Path) -> None:
    options = [
        "--jobs",
        "1",
        "--runs",
        "2",
        "--dimensions",
        "5",
        "--functions",
        "Sphere",
        "--methods",
        "nes,nes_fresh,cmaes",
    ]
    reproduce.main(["functions", *options, "--out", str(tmp_path)])
    page = (tmp_path / "functions.md").read_text()
    assert "| reported: cma 4.5 | *771* |" in page
    rows = {row["method"]: row for row in content(tmp_path, "functions")["rows"] if row["metric"] == "factor"}
    assert rows["NES: without / with importance mixing"]["mean"] > 3.0
    assert (tmp_path / "functions.png").exists()


def test_methods_beyond_the_thesis_have_fewer_runs(tmp_path: Path, made: list[str]) -> None:
    options = ["--jobs", "1", "--runs", "3", "--dimensions", "2", "--functions", "Sphere", "--methods", "cmaes,xnes"]
    reproduce.main(["functions", *options, "--fewer", "xnes=1", "--out", str(tmp_path)])
    assert sorted(made) == ["Sphere, d = 2: cmaes"] * 3 + ["Sphere, d = 2: xnes"]
