import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, cast

import pytest

from dpsearch.report.tables import SUCCESS_RATE
from scripts import reproduce
from scripts.experiments.jobs import Batch, Outcome, run_batch

QUICK = ["--jobs", "1", "--runs", "2", "--dimensions", "2"]


@pytest.fixture(autouse=True)
def made(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Make runs in this process; the tasks and methods of all that were made."""
    names: list[str] = []

    def one_by_one(todo: Iterable[Batch], processes: int) -> Iterator[tuple[Batch, list[Outcome]]]:
        for batch in todo:
            names.extend(f"{job.task}: {job.method}" for job in batch)
            yield batch, run_batch(batch)

    monkeypatch.setattr(reproduce, "run_all", one_by_one)
    return names


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


def test_table_4_1_has_all_functions(tmp_path: Path) -> None:
    reproduce.main(["table_4_1", "--out", str(tmp_path)])
    rows = {row["name"]: row for row in content(tmp_path, "table_4_1")["rows"]}
    assert len(rows) == 12
    assert rows["Ellipsoid"]["costs"]["e_d"] == pytest.approx(1e6)
    assert (rows["SharpR"]["least"], rows["SharpR"]["target"]) == (None, -1000.0)
    assert rows["Sphere"]["cost"] == "sum z_j^2"
    lines = (tmp_path / "table_4_1.md").read_text().splitlines()
    assert {line.replace(r"\|", "").count("|") for line in lines if line.startswith("|")} == {10}
    assert not (tmp_path / "table_4_1.png").exists()


def test_figure_4_4_shows_a_search_that_reaches_the_optimum(tmp_path: Path) -> None:
    reproduce.main(["fig_4_4", "--out", str(tmp_path)])
    found = content(tmp_path, "fig_4_4")
    first, last = found["ellipses"][0], found["ellipses"][-1]
    assert first["covariance"] == [[1.0, 0.0], [0.0, 1.0]]
    assert found["best"] <= 0.01
    assert max(abs(value) for value in last["mean"]) < 0.5
    assert f"reached a cost of 0.01 after {last['generation']} generations" in (tmp_path / "fig_4_4.md").read_text()
    assert (tmp_path / "fig_4_4.png").exists()
