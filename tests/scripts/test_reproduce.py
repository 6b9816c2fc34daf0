import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from dpsearch.report.tables import SUCCESS_RATE
from scripts import reproduce
from scripts.experiments import EXPERIMENTS
from scripts.experiments.experiment import Experiment
from scripts.experiments.jobs import Outcome
from scripts.experiments.tmaze.reported import LONGEST
from tests.support.runs_here import make_runs_here


@pytest.fixture(autouse=True)
def made(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Runs are made in this process."""
    return make_runs_here(monkeypatch)


class Pretence:
    """Stands for learning: succeeds in corridors up to 100, or ends the program after so many runs."""

    def __init__(self, interrupt_after: int | None = None) -> None:
        self.calls: list[tuple[tuple[str, ...], int]] = []
        self._interrupt_after = interrupt_after

    def __call__(self, overrides: tuple[str, ...], seed: int) -> Outcome:
        if len(self.calls) == self._interrupt_after:
            raise KeyboardInterrupt
        self.calls.append((overrides, seed))
        corridor = next(int(text.split("=")[1]) for text in overrides if text.startswith("env.corridor_length="))
        steps = 1000 * corridor + seed
        return {"solved": int(corridor <= 100), "env_steps": steps, "episodes": 9, "updates": 3, "core_seconds": 0.1}


def pretend(monkeypatch: pytest.MonkeyPatch, name: str, interrupt_after: int | None = None) -> Pretence:
    pretence, experiment = Pretence(interrupt_after), EXPERIMENTS[name]
    assert isinstance(experiment, Experiment)
    monkeypatch.setitem(EXPERIMENTS, name, replace(experiment, run=pretence))
    return pretence


def rows(out: Path, name: str) -> list[dict[str, Any]]:
    content = json.loads((out / f"{name}.json").read_text())
    found: list[dict[str, Any]] = content["rows"]
    return found


def test_a_tiny_figure_3_4_is_learned_and_written(tmp_path: Path) -> None:
    options = ["fig_3_4", "--corridors", "1", "--methods", "lstm", "--runs", "2", "--out", str(tmp_path)]
    reproduce.main(options)
    content = json.loads((tmp_path / "fig_3_4.json").read_text())
    assert content["name"] == "fig_3_4"
    assert content["command"] == f"python scripts/reproduce.py {' '.join(options)}"
    assert content["versions"].keys() >= {"dpsearch", "python", "torch"}
    rate = next(row for row in content["rows"] if row["metric"] == SUCCESS_RATE)
    assert (rate["runs"], rate["solved"], rate["mean"], rate["thesis"]) == (2, 2, 1.0, None)
    assert content["command"] in (tmp_path / "fig_3_4.md").read_text()
    assert (tmp_path / "fig_3_4.png").read_bytes().startswith(b"\x89PNG")


def test_an_interrupted_figure_goes_on_where_it_was(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    options = ["fig_3_4", "--corridors", "10,20", "--runs", "3", "--out", str(tmp_path)]
    first = pretend(monkeypatch, "fig_3_4", interrupt_after=5)
    with pytest.raises(SystemExit) as end:
        reproduce.main(options)
    assert end.value.code == 130
    log = (tmp_path / "fig_3_4.runs.jsonl").read_text()
    assert len(log.splitlines()) == 5
    second = pretend(monkeypatch, "fig_3_4")
    reproduce.main(options)
    assert len({*first.calls, *second.calls}) == len(first.calls) + len(second.calls) == 18
    assert (tmp_path / "fig_3_4.runs.jsonl").read_text().startswith(log)
    assert {row["runs"] for row in rows(tmp_path, "fig_3_4")} == {3, None}


def test_nothing_is_run_twice_unless_the_settings_change(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    options = ["fig_3_4", "--corridors", "10", "--methods", "lstm", "--runs", "2", "--out", str(tmp_path)]
    pretence = pretend(monkeypatch, "fig_3_4")
    reproduce.main(options)
    reproduce.main([*options, "--runs", "3"])
    assert [seed for _, seed in pretence.calls] == [0, 1, 2]
    reproduce.main([*options, "--step-limit", "1000"])
    assert [seed for _, seed in pretence.calls] == [0, 1, 2, 0, 1]


def test_the_thesis_stands_beside_our_numbers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pretend(monkeypatch, "fig_3_4")
    reproduce.main(["fig_3_4", "--corridors", "90,100,110", "--runs", "2", "--out", str(tmp_path)])
    thesis = {(row["task"], row["method"]): row["thesis"] for row in rows(tmp_path, "fig_3_4") if row["thesis"]}
    assert thesis == {
        ("T-maze", "RPG"): 90,
        ("T-maze", "RL-LSTM"): 50,
        ("T-maze", "Elman value iteration"): 10,
        ("T-maze, N = 90", "RPG"): 1.0,
        ("T-maze, N = 100", "RPG"): 0.78,
    }
    longest = {row["method"]: row["mean"] for row in rows(tmp_path, "fig_3_4") if row["metric"] == LONGEST}
    assert {method for method, corridor in longest.items() if corridor == 100} == {
        "RPG",
        "RPG, Elman network",
        "RPG, GRU",
    }
    assert {method for method, corridor in longest.items() if corridor is None} == {"RL-LSTM", "Elman value iteration"}


def test_the_peers_stand_beside_the_fast_setting(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pretend(monkeypatch, "tmaze_fast")
    reproduce.main(["tmaze_fast", "--runs", "3", "--out", str(tmp_path)])
    found = {(row["method"], row["task"], row["metric"]): row for row in rows(tmp_path, "tmaze_fast")}
    ours = found["RPG, tmaze_fast", "T-maze, N = 10", "env_steps"]
    assert (ours["median"], ours["runs"], ours["solved"]) == (10_001, 3, 3)
    theirs = found["CleanRL PPO-LSTM", "T-maze, N = 10", "env_steps"]
    assert (theirs["median"], theirs["runs"]) == (105_000, None)
    assert found["PufferLib", "T-maze, N = 50", "env_steps"]["solved"] == 0
    assert (tmp_path / "tmaze_fast.png").exists()


def test_a_corridor_that_no_run_solves_is_reported_too(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pretend(monkeypatch, "tmaze_long")
    reproduce.main(["tmaze_long", "--runs", "2", "--out", str(tmp_path)])
    rates = [row["mean"] for row in rows(tmp_path, "tmaze_long") if row["metric"] == SUCCESS_RATE]
    assert rates == [0.0, 0.0]
    assert (tmp_path / "tmaze_long.png").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["fig_9_9"], "invalid choice: 'fig_9_9'"),
        (["fig_3_4", "--corridors", "10,0"], "at least 1, got '0'"),
        (["fig_3_4", "--methods", "sarsa"], "unknown name 'sarsa'"),
        (["fig_3_4", "--runs", "0"], "at least 1, got '0'"),
        (["fig_3_4", "--seed", "-1"], "--seed"),
        (["fig_7_1", "--functions", "Sphere,Ackley"], "unknown name 'Ackley'"),
        (["fig_7_3", "--distances", "1,-1"], "expected positive numbers, got '1,-1'"),
    ],
)
def test_wrong_options_are_refused(options: list[str], words: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        reproduce.main(options)
    assert words in capsys.readouterr().err


def test_an_unwritable_folder_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(SystemExit, match=r"^error: .*file"):
        reproduce.main(["fig_3_4", "--out", str(tmp_path / "file" / "results")])


def test_all_computes_every_page_by_its_own_command(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in set(EXPERIMENTS) - {"fig_3_4", "table_4_1"}:
        monkeypatch.delitem(EXPERIMENTS, name)
    first = pretend(monkeypatch, "fig_3_4")
    own = ["fig_3_4", "--corridors", "10,20", "--methods", "lstm", "--runs", "3", "--out", str(tmp_path)]
    reproduce.main(own)
    page = (tmp_path / "fig_3_4.json").read_bytes()
    (tmp_path / "fig_3_4.runs.jsonl").unlink()
    again = pretend(monkeypatch, "fig_3_4")
    reproduce.main(["all", "--out", str(tmp_path)])
    assert again.calls == first.calls
    assert (tmp_path / "fig_3_4.json").read_bytes() == page
    assert (tmp_path / "table_4_1.md").exists()  # which had no page yet
