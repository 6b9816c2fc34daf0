"""The training application, run inside the test's own process or in one that can be killed."""

import contextlib
import io
import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import dpsearch.train

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Outcome:
    """What a run of the application left behind."""

    code: int
    out: str
    err: str


def train(*arguments: str) -> Outcome:
    """`python train.py ARGUMENTS`, without a new process."""
    out, err = io.StringIO(), io.StringIO()
    code = 0
    with (
        mock.patch.object(sys, "argv", ["train.py", *arguments]),
        mock.patch.dict(os.environ),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            dpsearch.train.main()
        except SystemExit as exit_:
            code = exit_.code if isinstance(exit_.code, int) else 1
    return Outcome(code, out.getvalue(), err.getvalue())


def start(*arguments: str, first: str = "", stderr: int = subprocess.PIPE) -> subprocess.Popen[str]:
    """`python train.py ARGUMENTS` in a process of its own, after running the code `first` there."""
    code = f"import dpsearch.train\n{first}\ndpsearch.train.main()"
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        stderr=stderr,
        text=True,
    )


def metrics(run: Path) -> list[dict[str, float]]:
    """The lines of a run's metrics, without what the clock says."""
    rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    return [{key: value for key, value in row.items() if not key.startswith("time/")} for row in rows]


def summary(run: Path) -> dict[str, Any]:
    """A run's summary, without what the clock says."""
    content: dict[str, Any] = json.loads((run / "summary.json").read_text())
    del content["wall_time_s"]
    return content
