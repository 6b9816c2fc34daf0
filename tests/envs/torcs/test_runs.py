"""Runs in TORCS: one whose simulator is killed says so, and goes on bit for bit."""

from __future__ import annotations

import re
from pathlib import Path

from tests.support.application import metrics, start, summary, train
from tests.support.torcs_wanted import require_torcs

require_torcs()

SMALL = (
    "env=torcs", "env.speed_profile=[40,60,20]", "env.stuck_seconds=0.5", "env.max_episode_steps=150",
    "algo.update_steps=100", "policy.hidden_size=3", "total_updates=12", "checkpoint_seconds=0.001",
)  # fmt: skip
KILL = """
import os, signal, dpsearch.runs.run
from dpsearch.envs.torcs.client import Simulator
dpsearch.runs.run.LOOK_SECONDS = 0
hold, steps = Simulator.hold, []
def fatal(self, *order):
    steps.append(order)
    if len(steps) == 765:
        os.kill(self.pid, signal.SIGKILL)
    return hold(self, *order)
Simulator.hold = fatal
"""


def test_a_run_whose_torcs_is_killed_says_how_to_go_on_and_does_so_exactly(tmp_path: Path) -> None:
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    assert train(*SMALL, f"run_dir={whole}").code == 0
    with start(*SMALL, f"run_dir={broken}", first=KILL) as process:
        _, error = process.communicate()
    assert process.returncode == 2
    last = error.strip().splitlines()[-1]
    assert re.match(r"error: the environment failed at step \d+ of episode \d+: .*TORCS was killed by SIGKILL", last)
    assert f"resume={broken}" in last
    assert 0 < len(metrics(broken)) < 12
    outcome = train(f"resume={broken}")
    assert outcome.code == 0, outcome.err
    assert metrics(broken) == metrics(whole)
    assert summary(broken) == summary(whole)
