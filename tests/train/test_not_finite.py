"""NaN and infinity, wherever they come from, end in files that can be read."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dpsearch.algos import RPG, Evaluation
from dpsearch.files import read_checkpoint
from tests.support.application import train

FEW = ("env.corridor_length=2", "until_solved=false", "total_updates=3", "evaluation_episodes=2", "progress=false")


def no_constants(name: str) -> Any:
    raise AssertionError(f"{name} is not JSON")


@pytest.mark.parametrize("paid", [np.nan, np.inf, -np.inf])
def test_the_summary_is_written_whatever_the_evaluation_finds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, paid: float
) -> None:
    def play(self: RPG, n_episodes: int, **_: object) -> Evaluation:
        return Evaluation(np.full(n_episodes, paid), np.ones(n_episodes, np.int64))

    monkeypatch.setattr(RPG, "play_evaluation", play)
    outcome = train(*FEW, f"run_dir={tmp_path / 'run'}")
    assert outcome.code == 0, outcome.err
    assert "NaN or infinite ± NaN or infinite stochastic" in outcome.out
    content = json.loads((tmp_path / "run" / "summary.json").read_text(), parse_constant=no_constants)
    assert content["return_stochastic"] is content["return_greedy_se"] is None


@pytest.mark.filterwarnings("ignore:NaN or infinite fitness")
def test_a_search_whose_fitness_is_not_finite_leaves_metrics_that_are_json(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from dpsearch.rollout import LaneEngine

    def evaluate(self: LaneEngine, *_: object, episodes: Any, **__: object) -> tuple[Any, Any]:
        return np.full(np.shape(episodes), np.nan), np.ones(np.shape(episodes), np.int64)

    monkeypatch.setattr(LaneEngine, "evaluate", evaluate)
    outcome = train(*FEW, "algo=xnes", f"run_dir={tmp_path / 'run'}")
    assert outcome.code == 0, outcome.err
    lines = (tmp_path / "run" / "metrics.jsonl").read_text().splitlines()
    rows = [json.loads(line, parse_constant=no_constants) for line in lines]
    assert [row["return"] for row in rows] == [None] * 3
    assert train(f"resume={tmp_path / 'run'}", "total_updates=4").code == 0


def test_weights_that_are_not_finite_are_not_saved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    update = RPG.update

    def spoiled(self: RPG) -> dict[str, float]:
        metrics = update(self)
        if self.updates == 2:
            self.policy.free_parameters()[0].data[0] = np.nan
        return metrics

    monkeypatch.setattr(RPG, "update", spoiled)
    monkeypatch.setattr("dpsearch.runs.run.LOOK_SECONDS", 0)
    outcome = train(*FEW, "checkpoint_seconds=1e-9", f"run_dir={tmp_path / 'run'}")
    assert outcome.code == 2
    assert re.search(r"error: a weight became NaN or infinite before update \d; the run so far is in", outcome.err)
    content = read_checkpoint(tmp_path / "run" / "checkpoint.pt")
    assert all(weights.isfinite().all() for weights in content["state"]["policy"].values())


def test_what_was_solved_in_training_says_which_episodes_judged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(RPG, "check_solved", lambda self: True)
    outcome = train(*FEW, "until_solved=true", f"run_dir={tmp_path / 'run'}")
    assert "solved (threshold 3.8, judged in training by other episodes)" in outcome.out
