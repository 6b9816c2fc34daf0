"""A signal ends a run such that it can go on; by a terminal that is closed, too."""

import os
import pty
import re
import signal
import time
from pathlib import Path
from subprocess import Popen

import pytest

from tests.support.application import metrics, start, summary, train

LIMITS = ("env.corridor_length=3", "until_solved=false", "evaluation_episodes=10", "total_steps=null")
SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


def wait_until_it_learns(process: Popen[str], run: Path) -> None:
    while not (run / "metrics.jsonl").exists() or not (run / "metrics.jsonl").stat().st_size:
        assert process.poll() is None, process.communicate()
        time.sleep(0.01)


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_saves_the_run_and_says_how_to_go_on(tmp_path: Path, number: signal.Signals) -> None:
    run = tmp_path / "run"
    process = start(*LIMITS, "total_updates=1000000", f"run_dir={run}", "progress=false")
    wait_until_it_learns(process, run)
    process.send_signal(number)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 128 + number
    rows = metrics(run)
    assert err.splitlines()[1:] == [
        f"{number.name}: stopping after this update; once more stops at once",
        f"{number.name} after update {len(rows)}; to go on: dpsearch-train resume={run}",
    ]
    outcome = train(f"resume={run}", f"total_updates={len(rows) + 20}")
    assert outcome.code == 0
    assert metrics(run)[: len(rows)] == rows
    assert train(*LIMITS, f"total_updates={len(rows) + 20}", f"run_dir={tmp_path / 'other'}").code == 0
    assert metrics(run) == metrics(tmp_path / "other")


def test_a_terminal_that_is_closed_saves_the_run(tmp_path: Path) -> None:
    run = tmp_path / "run"
    ours, theirs = pty.openpty()
    eager = "import dpsearch.runs.run as r; r.LOOK_SECONDS = 0"  # writes to the terminal whenever it can
    process = start(*LIMITS, "total_updates=1000000", f"run_dir={run}", first=eager, stderr=theirs)
    os.close(theirs)
    wait_until_it_learns(process, run)
    os.close(ours)
    process.send_signal(signal.SIGHUP)
    process.communicate(timeout=120)
    assert process.returncode == 128 + signal.SIGHUP
    assert train(f"resume={run}", f"total_updates={len(metrics(run)) + 2}").code == 0


def test_a_run_goes_on_when_nobody_reads_its_progress(tmp_path: Path) -> None:
    run, (reader, writer) = tmp_path / "run", os.pipe()
    lines = "import dpsearch.runs.run as r, dpsearch.runs.progress_bar as p; r.LOOK_SECONDS = p.LINE_SECONDS = 0"
    process = start(*LIMITS, "total_updates=60", f"run_dir={run}", first=lines, stderr=writer)
    os.close(writer)
    os.read(reader, 1)
    os.close(reader)
    process.communicate(timeout=120)
    assert len(metrics(run)) == 60


def test_a_signal_that_is_ignored_stays_so(tmp_path: Path) -> None:
    run = tmp_path / "run"
    ignore = "import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)"  # nohup
    process = start(*LIMITS, "total_updates=300", f"run_dir={run}", first=ignore)
    wait_until_it_learns(process, run)
    process.send_signal(signal.SIGHUP)
    process.communicate(timeout=120)
    assert (process.returncode, len(metrics(run))) == (0, 300)


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize(
    "env", [("env=tmaze", "env.corridor_length=3"), ("env=gym", "env.id=CartPole-v1")], ids=["lanes", "gym"]
)
def test_a_signal_ends_a_long_final_evaluation(tmp_path: Path, number: signal.Signals, env: tuple[str, str]) -> None:
    run = tmp_path / "run"
    send = (  # once the evaluation has begun
        "import os, threading\nfrom dpsearch.algos import RPG\nplay = RPG.play_evaluation\n"
        f"def sent(*a, **k):\n  threading.Timer(0.5, os.kill, (os.getpid(), {number:d})).start()\n"
        "  RPG.play_evaluation = play\n  return play(*a, **k)\nRPG.play_evaluation = sent"
    )
    few = ("until_solved=false", "total_updates=2", "evaluation_episodes=2", "progress=false")
    process = start(*env, *few, "evaluation_episodes=16777216", f"run_dir={run}", first=send)
    _, err = process.communicate(timeout=200)
    assert process.returncode == 128 + number, err
    assert err.splitlines()[-2:] == [
        f"{number.name}: stopping",
        f"{number.name} after update 2; to go on: dpsearch-train resume={run}",
    ]
    assert not (run / "summary.json").exists()


def test_an_evaluation_in_parts_is_the_evaluation_as_a_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    few = ("env.corridor_length=3", "until_solved=false", "total_updates=2", "evaluation_episodes=50")
    assert train(*few, f"run_dir={tmp_path / 'whole'}").code == 0
    monkeypatch.setattr("dpsearch.runs.run.FIRST_PART", 3)
    assert train(*few, f"run_dir={tmp_path / 'parts'}").code == 0
    assert summary(tmp_path / "whole") == summary(tmp_path / "parts")


def test_what_ended_can_be_resumed_to_its_end(tmp_path: Path) -> None:
    run = tmp_path / "run"
    process = start(*LIMITS, "total_updates=1000000", f"run_dir={run}", "progress=false")
    wait_until_it_learns(process, run)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=120)
    outcome = train(f"resume={run}", f"total_updates={len(metrics(run))}", "progress=false")
    assert outcome.code == 0
    assert re.search(r"^nothing more to learn: total_updates=\d+ is counted", outcome.err, re.M)
