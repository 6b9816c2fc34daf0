"""Several processes that train at once, in one place."""

import json
import signal
from pathlib import Path
from subprocess import Popen

import pytest

from dpsearch.runs import RunDirectory
from tests.support.application import metrics, start, summary, train

FEW = ("env.corridor_length=3", "until_solved=false", "total_updates=5", "evaluation_episodes=10", "progress=false")

# Processes take unlike time to come to where they would collide: each says that it is there, and waits for the others
MEET = """
import pathlib, time, dpsearch.runs.directory as d
def meet(method):
    def met(*arguments):
        pathlib.Path({here!r}, str(__import__("os").getpid())).touch()
        deadline = time.monotonic() + 60
        while len(list(pathlib.Path({here!r}).iterdir())) < {count} and time.monotonic() < deadline:
            time.sleep(0.001)
        return method(*arguments)
    return met
d.RunDirectory.{method} = meet(d.RunDirectory.{method})
"""


def meeting(folder: Path, method: str, count: int) -> str:
    folder.mkdir()
    return MEET.format(here=str(folder), method=method, count=count)


def outcomes(processes: list[Popen[str]]) -> list[tuple[int, str]]:
    return [(process.returncode, error) for process in processes for _, error in [process.communicate(timeout=120)]]


def test_of_runs_begun_at_once_in_one_directory_one_is_made_and_can_be_resumed(tmp_path: Path) -> None:
    run, first = tmp_path / "run", meeting(tmp_path / "meeting", "begin", 2)
    ended = outcomes([start(*FEW, f"seed={seed}", f"run_dir={run}", first=first) for seed in range(2)])
    assert sorted(code for code, _ in ended) == [0, 2]
    assert all("already holds a run" in error for code, error in ended if code == 2)
    (winner,) = (seed for seed, (code, _) in enumerate(ended) if code == 0)
    assert summary(run)["seed"] == RunDirectory(run).read_config()[0].seed == winner
    assert train(f"resume={run}", "total_updates=8").code == 0
    assert train(*FEW, "total_updates=8", f"seed={winner}", f"run_dir={tmp_path / 'other'}").code == 0
    assert metrics(run) == metrics(tmp_path / "other")


def test_runs_begun_at_once_without_a_directory_each_get_one(tmp_path: Path) -> None:
    frozen = (
        f"import os; os.chdir({str(tmp_path)!r})\nfrom datetime import datetime as real\n"
        "class Frozen(real):\n    now = staticmethod(lambda: real(2020, 1, 1))\n"
        "dpsearch.train.datetime = Frozen\n" + meeting(tmp_path / "meeting", "free", 2)
    )
    frozen = frozen.replace(
        "d.RunDirectory.free = meet(d.RunDirectory.free)",
        "d.RunDirectory.free = staticmethod(meet(d.RunDirectory.free))",
    )
    ended = outcomes([start(*FEW, first=frozen) for _ in range(2)])
    assert [code for code, _ in ended] == [0, 0], ended
    runs = sorted(path.parent.name for path in (tmp_path / "runs" / "rpg" / "tmaze").glob("*/summary.json"))
    assert runs == ["2020-01-01_00-00-00_seed0" + suffix for suffix in ("", "_2")]


def test_a_run_that_is_at_work_is_not_resumed_beside_it(tmp_path: Path) -> None:
    pytest.importorskip("fcntl")
    run = tmp_path / "run"
    endless = ("until_solved=false", "total_steps=null", "total_updates=1000000", "progress=false")
    process = start("env.corridor_length=3", *endless, f"run_dir={run}")
    try:
        while not (run / "checkpoint.pt").exists():
            assert process.poll() is None, process.communicate()
        before = (run / ".hydra" / "config.yaml").read_bytes()
        assert "another process is at work" in train(f"resume={run}", "total_updates=3").err
        assert (run / ".hydra" / "config.yaml").read_bytes() == before
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)
    assert json.loads((run / "metrics.jsonl").read_text().splitlines()[-1])["update"] == len(metrics(run))
