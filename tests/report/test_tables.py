import json
from dataclasses import replace
from pathlib import Path

import pytest

from dpsearch.report.tables import SUCCESS_RATE, Row, Section, Table, number

BLANK = Row(task="maze", method="RPG", network="LSTM", metric="env_steps", runs=4)
WORDS = {SUCCESS_RATE: "solved", "env_steps": "steps"}


def table(*rows: Row) -> Table:
    return Table(
        name="fig",
        title="A figure",
        text="What it shows.",
        command="python scripts/reproduce.py fig",
        versions={"dpsearch": "1"},
        machine="a machine",
        words=WORDS,
        statistic="mean",
        sections=[Section("Measured", rows)],
    )


def lines(*rows: Row) -> list[list[str]]:
    """The cells of the table's lines."""
    text = table(*rows).document().markdown().splitlines()
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in text if line.startswith("|")]


def test_a_row_sums_up_the_runs_that_succeeded() -> None:
    row = BLANK.with_values([1.0, 2.0, 6.0], "mean")
    assert (row.runs, row.solved, row.mean, row.median) == (4, 3, 3.0, 2.0)
    assert row.std == pytest.approx(7**0.5)
    assert row.ci_low is not None
    assert row.ci_high is not None
    assert 1.0 <= row.ci_low < 3.0 < row.ci_high <= 6.0


def test_a_row_of_no_runs_that_succeeded_has_no_numbers() -> None:
    row = BLANK.with_values([], "mean")
    assert row == replace(BLANK, solved=0)
    assert lines(row)[-1][-1] == "–"


def test_the_json_has_the_keys_that_were_agreed_on(tmp_path: Path) -> None:
    table(BLANK.with_values([1.0], "mean")).document().write(tmp_path)
    content = json.loads((tmp_path / "fig.json").read_text())
    assert {"name", "command", "versions", "rows"} <= content.keys()
    names = "task method network metric runs solved mean std median ci_low ci_high thesis"
    assert list(content["rows"][0]) == names.split()
    assert content["rows"][0]["std"] is None
    assert sorted(path.name for path in tmp_path.iterdir()) == ["fig.json", "fig.md"]


def test_metrics_of_one_method_share_a_line_with_the_thesis_beside_them() -> None:
    rate = replace(BLANK, metric=SUCCESS_RATE, thesis=0.78).with_successes(3)
    head, _, line = lines(rate, BLANK.with_values([1.0, 2.0, 3.0], "mean"))
    assert head == ["task", "method", "network", "solved", "thesis", "steps"]
    assert line[:3] == ["maze", "RPG", "LSTM"]
    assert line[3].startswith("3 of 4 [")
    assert line[4] == "78%"
    assert line[5].startswith("2 ± 1 [")


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [(105_000, 105_000, "*105,000*"), (40, 50, "*40 to 50*"), (350, None, "*> 350*")],
)
def test_reported_numbers_are_marked(low: float, high: float | None, text: str) -> None:
    row = replace(BLANK, runs=None).with_report(low, high)
    assert lines(row)[-1][-1] == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0, "0"), (0.0123456, "0.0123"), (9.806, "9.81"), (105_432, "105,000"), (20_000_000, "20,000,000")],
)
def test_numbers_have_three_digits_and_are_written_in_full(value: float, text: str) -> None:
    assert number(value) == text
