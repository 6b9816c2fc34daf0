"""Tables 6.1, 7.1 and 7.2."""

from __future__ import annotations

import json
from argparse import Namespace
from pathlib import Path

import numpy as np
import pytest

from dpsearch.algos import RPG
from dpsearch.policies import PolicyConfig
from scripts.experiments.pomdps import tables as pomdps
from scripts.experiments.pomdps.tables import METHODS, RPG_THESIS, cell, judged, learn_and_play
from scripts.experiments.pomdps.tasks import BEHIND, TASKS, TEXT, yardsticks
from scripts.reproduce import main

RANDOM = {
    "tiger_single": -36,
    "maze4x3_any_way": 0.056,
    "cheese_anywhere": 0.072,
    "tmaze3_either": 0.166,
    "tmaze5_either": 0.046,
}


@pytest.mark.parametrize("name", RANDOM)
def test_the_tasks_behind_the_thesis_s_numbers_have_its_random_policy_s(name: str) -> None:
    assert yardsticks(name).random.thesis_metric.value == pytest.approx(RANDOM[name], rel=0.04)


def test_the_optimal_policy_of_the_4x3_maze_has_the_thesis_s_numbers_of_those_by_hand_and_by_rpg() -> None:
    assert yardsticks("maze4x3_any_way").optimal.thesis_metric.value == pytest.approx(0.27, abs=0.005)
    assert yardsticks("maze4x3").optimal.thesis_metric.value == pytest.approx(0.21, abs=0.005)


@pytest.mark.parametrize("task", [*TEXT, *BEHIND], ids=lambda task: str(task.name))
def test_a_task_s_configuration_is_its_tables(task: object) -> None:
    name = next(name for name, known in TASKS.items() if known is task)
    settings = cell(RPG_THESIS, TASKS[name]).settings
    env = settings.config.env  # type: ignore[attr-defined]
    made, meant = env.recipe().make().unwrapped.task.pomdp, TASKS[name].task().pomdp
    assert env.gamma == meant.discount
    for array in ("rewards", "features", "terminal", "observation_row"):
        np.testing.assert_array_equal(getattr(made, array), getattr(meant, array))


@pytest.mark.parametrize("name", TASKS)
def test_written_by_hand_is_between_random_and_optimal(name: str) -> None:
    known = yardsticks(name)
    assert 0.9 < known.share(known.hand.discounted_return.value) < 1.01


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


def test_a_policy_is_judged_by_all_metrics() -> None:
    algorithm = RPG("dpsearch/Tiger-v0", policy=PolicyConfig(init_range=0.0))  # all actions equally likely
    known = yardsticks("tiger").random
    found = judged(algorithm, 0.75, 1000, greedy=False)
    for metric in ("episode_return", "reward_per_step", "thesis_metric", "discounted_return"):
        estimate = getattr(found, metric)
        assert abs(estimate.value - getattr(known, metric).value) < 4 * estimate.standard_error


def test_a_run_says_how_far_both_of_its_policies_got() -> None:
    task = TASKS["maze4x3"]
    outcome = learn_and_play(("maze4x3", cell(METHODS["cmaes"], task).recipe[1]), 0)  # type: ignore[index]
    assert 3000 <= outcome["episodes"] < 3100
    assert 0.3 < outcome["sampled_share"] < 1.02
    assert outcome["sampled_discounted_return"] > -1.0  # at random -1.96
    assert outcome["sampled_episode_return"] == pytest.approx(outcome["sampled_discounted_return"], abs=1e-5)  # gamma 1


def test_the_table_has_what_is_known_beside_what_is_learned(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--methods", "nes", "--tasks", "tiger_single,maze4x3", "--runs", "2", "--jobs", "1"]
    main(["table_7_2", *options, "--out", str(tmp_path)])
    text = capsys.readouterr().out
    assert "| optimal | *1.26* |  |" in text  # with a column for the thesis's numbers
    assert "| NES, greedy |" in text
    rows = json.loads((tmp_path / "table_7_2.json").read_text())["rows"]
    assert {row["metric"] for row in rows} >= {"share", "thesis_metric", "discounted_return", "success_rate"}
    assert (tmp_path / "table_7_2.png").stat().st_size > 10_000


def test_table_7_1_is_made_from_the_environments(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["table_7_1", "--out", str(tmp_path)])
    text = capsys.readouterr().out
    assert "| Shuttle docking | 8 | 3 | 5 | yes | yes |" in text
    assert "| 89-state maze | 89 | 5 | 16 (17) | yes | yes |" in text


@pytest.mark.parametrize(("option", "known"), [("--methods", "rpg_thesis"), ("--tasks", "tiger_single")])
def test_an_unknown_name_is_refused_with_those_that_exist(
    option: str, known: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["table_7_2", option, "chess"])
    assert known in capsys.readouterr().err
