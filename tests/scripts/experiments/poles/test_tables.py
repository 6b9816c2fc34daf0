"""The tables of pole balancing."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dpsearch.report.tables import SUCCESS_RATE
from scripts import reproduce
from scripts.experiments.poles import tables as poles


def test_a_table_has_the_thesis_s_numbers_beside_ours(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    reproduce.main(["table_5_1", "--runs", "1", "--methods", "fem", "--jobs", "1", "--out", str(tmp_path)])
    content = json.loads((tmp_path / "table_5_1.json").read_text())
    rates = {row["task"]: row["solved"] for row in content["rows"] if row["metric"] == SUCCESS_RATE}
    assert rates == dict.fromkeys(poles.TASKS.values(), 1)
    assert "| FEM |" in capsys.readouterr().out
    assert (tmp_path / "table_5_1.png").exists()


def test_methods_as_in_the_thesis_stand_beside_its_numbers() -> None:
    cell = poles.cell(poles.FEM_THESIS, "double_pole_hidden", poles.LSTM, "2 poles")
    assert cell.thesis == {"evaluations": 1304, "evaluations_std": 801, SUCCESS_RATE: 0.76}
    assert not poles.cell(poles.FEM, "double_pole_hidden", poles.LSTM, "2 poles").thesis


def test_the_log_of_runs_is_shared_and_what_others_report_is_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--methods", "xnes", "--runs", "1", "--jobs", "1", "--out", str(tmp_path)]
    reproduce.main(["poles_one_unit", *options])
    assert "reported: CoSyNE | *410*" in capsys.readouterr().out
    first = (tmp_path / "poles.runs.jsonl").read_text()
    reproduce.main(["table_7_4", *options])
    assert (tmp_path / "poles.runs.jsonl").read_text().startswith(first)
    assert len((tmp_path / "poles.runs.jsonl").read_text().splitlines()) == 3
    assert "reported: CoSyNE | *1,250*" in capsys.readouterr().out


def test_an_unknown_method_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        reproduce.main(["table_7_4", "--methods", "sane"])
    assert "unknown name 'sane'" in capsys.readouterr().err
