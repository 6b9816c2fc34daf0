import json
from typing import Any

import pytest

from dpsearch.report.cross_tables import Grid
from dpsearch.report.tables import SUCCESS_RATE, Row, Section
from scripts.experiments.experiment import Cell, Method
from scripts.experiments.jobs import Outcome


class Described:
    network = "LSTM, 2 cells"

    def fingerprint(self) -> str:
        return "abc"


def cell(task: str, thesis: dict[str, float]) -> Cell:
    return Cell(task, Method("nes", "NES"), ("algo=nes",), Described(), thesis)


def grid(rows: list[Row], **options: Any) -> Grid:
    return Grid(
        name="table_4_2", title="Poles", text="Text.", command="python x", versions={"python": "3"}, machine="one core",
        words={SUCCESS_RATE: "solved", "evaluations": "evaluations"}, statistic="mean",
        sections=[Section("All", rows)], line=lambda row: row.method, column=lambda row: row.task, corner="method",
        **options,
    )  # fmt: skip


OUTCOMES: list[Outcome] = [{"solved": 1, "evaluations": 100 + 20 * k} for k in range(4)] + [{"solved": 0}]


def test_the_thesis_with_its_deviation_and_successes_follows_a_task() -> None:
    thesis = {"evaluations": 1304.0, "evaluations_std": 801.0, SUCCESS_RATE: 0.76}
    rows = cell("two poles", thesis).rows(OUTCOMES, ["evaluations"], "mean")
    rows += cell("one pole", {}).rows(OUTCOMES[:4], ["evaluations"], "mean")
    lines = grid(rows).document().markdown().splitlines()
    assert "| method | two poles | thesis | one pole |" in lines
    line = next(line for line in lines if line.startswith("| NES |"))
    assert "130 ± 25.8 [" in line
    assert "(4 of 5) | 1,300 ± 801 (76%) |" in line
    assert line.endswith("] |")
    found = {row.metric: row for row in rows if row.task == "two poles"}
    assert found["evaluations_std"].mean == pytest.approx(25.8, rel=0.01)
    assert found["evaluations_std"].thesis == 801.0


def test_where_no_run_succeeds_the_grid_says_so() -> None:
    rows = cell("two poles", {}).rows([{"solved": 0}] * 3, ["evaluations"], "mean")
    assert "| NES | – (0 of 3) |" in grid(rows).document().markdown()


def test_the_json_holds_the_rows_and_what_else_there_is_with_numbers_on_one_line() -> None:
    rows = cell("two poles", {}).rows(OUTCOMES, ["evaluations"], "mean")
    text = grid(rows, extra={"curves": [{"median": [1.5, -2.0, 1e-10]}]}).document().json()
    assert '"median": [1.5, -2.0, 1e-10]' in text
    content = json.loads(text)
    assert content.keys() == {"name", "command", "versions", "machine", "interval", "rows", "curves"}
    assert len(content["rows"]) == 2
