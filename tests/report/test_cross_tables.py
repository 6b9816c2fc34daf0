import json
from dataclasses import replace
from typing import Any

from dpsearch.report.cross_tables import Grid
from dpsearch.report.tables import SUCCESS_RATE, Row, Section

VALUES = [100.0, 120.0, 140.0, 160.0]


def grid(rows: list[Row], **options: Any) -> Grid:
    return Grid(
        name="table_4_2", title="Poles", text="Text.", command="python x", versions={"python": "3"}, machine="one core",
        words={SUCCESS_RATE: "solved", "evaluations": "evaluations"}, statistic="mean",
        sections=[Section("All", rows)], line=lambda row: row.method, column=lambda row: row.task, corner="method",
        **options,
    )  # fmt: skip


def cell(task: str, runs: int, *, thesis: tuple[float, float, float] | None = None, solved: int = 4) -> list[Row]:
    """The rows of one cell: success rate, evaluations and their deviation, each with the thesis's number, if any."""
    evaluations, std, rate = (None, None, None) if thesis is None else thesis
    blank = Row(task=task, method="NES", network="", metric="", runs=runs)
    rows = [
        replace(blank, metric=SUCCESS_RATE, thesis=rate).with_successes(solved),
        replace(blank, metric="evaluations", thesis=evaluations).with_values(VALUES[:solved], "mean"),
    ]
    return rows if thesis is None else [*rows, replace(blank, metric="evaluations_std", thesis=std)]


def test_the_thesis_with_its_deviation_and_successes_follows_a_task() -> None:
    rows = [*cell("two poles", 5, thesis=(1304.0, 801.0, 0.76)), *cell("one pole", 4)]
    lines = grid(rows).document().markdown().splitlines()
    assert "| method | two poles | thesis | one pole |" in lines
    line = next(line for line in lines if line.startswith("| NES |"))
    assert "130 ± 25.8 [" in line
    assert "(4 of 5) | 1,300 ± 801 (76%) |" in line
    assert line.endswith("] |")


def test_where_no_run_succeeds_the_grid_says_so() -> None:
    assert "| NES | – (0 of 3) |" in grid(cell("two poles", 3, solved=0)).document().markdown()


def test_the_json_holds_the_rows_and_what_else_there_is_with_numbers_on_one_line() -> None:
    text = grid(cell("two poles", 5), extra={"curves": [{"median": [1.5, -2.0, 1e-10]}]}).document().json()
    assert '"median": [1.5, -2.0, 1e-10]' in text
    content = json.loads(text)
    assert content.keys() == {"name", "command", "versions", "machine", "interval", "rows", "curves"}
    assert len(content["rows"]) == 2
