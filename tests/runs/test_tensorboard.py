from pathlib import Path

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from dpsearch.runs.tensorboard import TensorBoardLog

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


def test_a_resumed_run_disowns_the_points_that_it_repeats(tmp_path: Path) -> None:
    first = TensorBoardLog(tmp_path, HYPERPARAMETERS, env_steps=0)
    for step in (100, 200, 300):
        first.add({"return": float(step)})
        first.write(step, now=1e9 + step)
    first.close()
    (events,) = tmp_path.iterdir()
    events.rename(events.with_name("events.out.tfevents.1"))  # certainly the older one
    second = TensorBoardLog(tmp_path, HYPERPARAMETERS, env_steps=200)
    second.add({"return": -1.0})
    second.write(250, now=1e9)
    second.close()
    assert points(tmp_path, "return") == [(100, 100.0), (200, 200.0), (250, -1.0)]


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
