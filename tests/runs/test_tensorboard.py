from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from dpsearch.runs.tensorboard import TensorBoardLog
from tests.support.application import start, train

HYPERPARAMETERS = {"algo": {"gamma": 0.9, "gradient_length": None}, "seed": 3, "env": {"id": "Maze-v0"}}


def curves(path: Path) -> EventAccumulator:
    accumulator = EventAccumulator(str(path))
    accumulator.Reload()
    return accumulator


def points(path: Path, name: str) -> list[tuple[int, float]]:
    return [(event.step, event.value) for event in curves(path).Scalars(name)]


def test_a_point_is_the_mean_over_the_updates_since_the_last(tmp_path: Path) -> None:
    log = TensorBoardLog(tmp_path, HYPERPARAMETERS, env_steps=0)
    log.add({"return": 1.0, "entropy": 0.5})
    log.add({"return": 2.0, "entropy": 0.5})
    log.write(100, now=1e9)
    log.add({"return": 4.0, "entropy": 0.25})
    log.write(300, now=1e9 + 2.0)
    log.close()
    assert points(tmp_path, "return") == [(100, 1.5), (300, 4.0)]
    assert points(tmp_path, "entropy") == [(100, 0.5), (300, 0.25)]
    assert points(tmp_path, "steps_per_second")[1] == (300, 100.0)


def test_nothing_is_written_where_nothing_was_learned(tmp_path: Path) -> None:
    log = TensorBoardLog(tmp_path, HYPERPARAMETERS, env_steps=0)
    log.write(100, now=1e9)
    log.close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("steps", "kept"), [(0, 0), (200, 2)], ids=["at the start", "later"])
def test_a_resumed_run_disowns_the_points_that_it_repeats(tmp_path: Path, steps: int, kept: int) -> None:
    first = TensorBoardLog(tmp_path, HYPERPARAMETERS, env_steps=0)
    for step in (100, 200, 300):
        first.add({"return": float(step)})
        first.write(step, now=1e9 + step)
    first.close()
    (events,) = tmp_path.iterdir()
    events.rename(events.with_name("events.out.tfevents.1"))  # certainly the older one
    second = TensorBoardLog(tmp_path, HYPERPARAMETERS, env_steps=steps)
    second.add({"return": -1.0})
    second.write(250, now=1e9)
    second.close()
    assert points(tmp_path, "return") == [*[(100, 100.0), (200, 200.0)][:kept], (250, -1.0)]


def test_the_hyperparameter_table_belongs_to_the_run_itself(tmp_path: Path) -> None:
    log = TensorBoardLog(tmp_path, HYPERPARAMETERS, env_steps=0)
    log.write_evaluation(100, stochastic=1.0, greedy=2.0)
    log.close()
    assert [path.name.startswith("events.out.tfevents") for path in tmp_path.iterdir()] == [True]
    plugin = curves(tmp_path).summary_metadata
    assert {
        "_hparams_/experiment",
        "_hparams_/session_start_info",
        "_hparams_/session_end_info",
    } <= plugin.keys()
    start = plugin["_hparams_/session_start_info"].plugin_data.content
    for text in (b"algo.gamma", b"algo.gradient_length", b"None", b"env.id", b"Maze-v0", b"seed"):
        assert text in start


@pytest.mark.parametrize(("name", "value"), [("evaluation/stochastic", 1.0), ("evaluation/greedy", 2.0)])
def test_what_the_policy_achieves_is_a_point_too(tmp_path: Path, name: str, value: float) -> None:
    log = TensorBoardLog(tmp_path, {}, env_steps=0)
    log.write_evaluation(100, stochastic=1.0, greedy=2.0)
    log.close()
    assert points(tmp_path, name) == [(100, value)]


def test_what_is_not_finite_is_no_point(tmp_path: Path) -> None:
    log = TensorBoardLog(tmp_path, {}, env_steps=0)
    log.write_evaluation(100, stochastic=float("nan"), greedy=2.0)
    log.close()
    assert "evaluation/stochastic" not in curves(tmp_path).Tags()["scalars"]


def test_a_run_killed_anywhere_and_resumed_has_each_point_once(tmp_path: Path) -> None:
    few = ("env.corridor_length=3", "until_solved=false", "total_updates=40", "evaluation_episodes=10")
    eager = "import dpsearch.runs.run as r; r.LOOK_SECONDS = r.POINT_SECONDS = 0\n"
    kill = (
        "import os, time\nfrom dpsearch.algos import RPG\nplay = RPG.play_batch\ndef die(self, n):\n"
        "  if self.updates == 23: time.sleep(1.1); os.kill(os.getpid(), 9)\n  return play(self, n)\n"
        "RPG.play_batch = die"
    )  # a second later, the file of events has another name
    flush = "import dpsearch.runs.tensorboard as t\nwrite = t.TensorBoardLog.write\n" + (
        "def flushed(self, *a):\n  write(self, *a); self.flush()\nt.TensorBoardLog.write = flushed\n"
    )
    run = tmp_path / "run"
    process = start(*few, f"run_dir={run}", "checkpoint_seconds=1e9", first=eager + flush + kill)
    process.communicate(timeout=120)
    assert process.returncode == -9
    assert len(points(run, "return")) > 10
    process = start(f"resume={run}", first=eager)
    process.communicate(timeout=120)
    for _ in range(2):
        steps = [step for step, _ in points(run, "return")]
        assert len(steps) == len(set(steps)) == 40
        assert len(points(run, "evaluation/greedy")) == 1
        assert train(f"resume={run}").code == 0
