"""A run whose environment fails goes on past the episode that ended it."""

from pathlib import Path

import pytest

from tests.support.application import metrics, train

STUCK = ("algo=rpg", "env=gym", "env.id=tests.support.odd_envs:tests/Stuck-v0", "algo.batch_size=4", "progress=false")


@pytest.mark.filterwarnings("ignore:the environment failed")
def test_a_run_that_an_environment_ended_says_how_it_goes_on_and_does(tmp_path: Path) -> None:
    run = tmp_path / "run"
    ended = train(*STUCK, f"run_dir={run}", "total_updates=8", "evaluation_episodes=2", "checkpoint_seconds=1e-9")
    assert ended.code == 2
    (line,) = (text for text in ended.err.splitlines() if text.startswith("error: "))
    assert "the environment failed at step 1 of episode" in line
    assert "RuntimeError: out of fuel; the run so far is in" in line
    assert line.endswith(f"resume={run} rollout.on_error=retry")
    before = metrics(run)
    again = train(f"resume={run}")
    assert again.code == 2  # for the same reason
    finished = train(f"resume={run}", "rollout.on_error=retry")
    assert finished.code == 0, finished.err
    assert len(metrics(run)) == 8
    assert metrics(run)[: len(before)] == before


def test_a_way_with_errors_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    outcome = train(*STUCK, f"run_dir={tmp_path / 'run'}", "rollout.on_error=ignore")
    assert (outcome.code, outcome.err.strip()) == (2, "error: rollout.on_error must be raise or retry, got ignore")
