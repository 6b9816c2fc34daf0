"""Tables 6.1 and 7.2."""

from __future__ import annotations

import json
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

from scripts.experiments.pomdps import tables as pomdps
from scripts.experiments.pomdps.tables import METHODS, RPG_THESIS, cell
from scripts.experiments.pomdps.tasks import BEHIND, TASKS, TEXT
from scripts.reproduce import main


@pytest.mark.parametrize("task", [*TEXT, *BEHIND], ids=lambda task: str(task.name))
def test_a_task_s_configuration_is_its_tables(task: object) -> None:
    name = next(name for name, known in TASKS.items() if known is task)
    settings = cell(RPG_THESIS, TASKS[name]).settings
    env = settings.config.env  # type: ignore[attr-defined]
    made, meant = env.recipe().make().unwrapped.task.pomdp, TASKS[name].task().pomdp
    assert env.gamma == meant.discount
    for array in ("rewards", "features", "terminal", "observation_row"):
        np.testing.assert_array_equal(getattr(made, array), getattr(meant, array))


def test_every_method_has_settings_for_every_task_and_the_thesis_s_numbers() -> None:
    cells = pomdps.cells(Namespace(methods=list(METHODS.values()), tasks=list(TASKS.values())))
    tried = [each.task for each in cells if each.method.name == "lrwr_farsighted"]
    assert tried == ["Cheese maze", "Cheese, from anywhere"]
    assert len({each.settings.fingerprint() for each in cells}) == len(cells)
    assert cell(METHODS["lrwr_thesis"], TASKS["shuttle"]).thesis["sampled_thesis_metric"] == 0.709
    assert cell(METHODS["nes"], TASKS["tiger_single"]).thesis["sampled_thesis_metric"] == -15.6
    assert cell(METHODS["fem"], TASKS["maze4x3_any_way"]).thesis["sampled_thesis_metric"] == 0.246
    assert not cell(METHODS["nes"], TASKS["maze4x3"]).thesis
    assert not cell(METHODS["nes"], TASKS["tiger"]).thesis  # whose numbers are those of another task


def test_the_table_has_what_is_known_beside_what_is_learned(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--methods", "nes", "--tasks", "tiger_single,maze4x3", "--runs", "2", "--jobs", "1"]
    main(["table_7_2", *options, "--out", str(tmp_path)])
    text = capsys.readouterr().out
    assert "| optimal | *1.26* |  |" in text  # with a column for the thesis's numbers
    assert "| NES, greedy |" in text
    rows = json.loads((tmp_path / "table_7_2.json").read_text())["rows"]
    assert {row["metric"] for row in rows} >= {"share", "thesis_metric", "discounted_return", "success_rate"}
    assert (tmp_path / "table_7_2.png").stat().st_size > 10_000


@pytest.mark.parametrize(("option", "known"), [("--methods", "rpg_thesis"), ("--tasks", "tiger_single")])
def test_an_unknown_name_is_refused_with_those_that_exist(
    option: str, known: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["table_7_2", option, "chess"])
    assert known in capsys.readouterr().err
