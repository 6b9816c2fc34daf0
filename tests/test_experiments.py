"""The settings in ``configs/experiment/``: each runs, and does what it is there for."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.support.application import ROOT, metrics, summary, train

EXPERIMENTS = sorted(path.stem for path in (ROOT / "configs" / "experiment").glob("*.yaml"))


@pytest.mark.parametrize("experiment", EXPERIMENTS)
def test_an_experiment_makes_its_first_update(experiment: str, tmp_path: Path) -> None:
    run = tmp_path / "run"
    outcome = train(f"experiment={experiment}", f"run_dir={run}", "total_updates=1", "evaluation_episodes=2")
    assert (outcome.code, len(metrics(run))) == (0, 1), outcome.err


def test_tmaze_fast_remembers_after_few_steps(tmp_path: Path) -> None:
    run = tmp_path / "run"
    train("experiment=tmaze_fast", "env.corridor_length=10", f"run_dir={run}", "total_steps=200_000")
    assert summary(run)["solved"]
