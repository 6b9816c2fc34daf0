"""Many runs in several processes, each made once: what is in the log is not run again."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path

import torch

Outcome = dict[str, float]
"""The numbers that came out of a run; ``solved`` is 0 or 1."""
Work = Callable[[tuple[str, ...], int], Outcome]
"""Makes one run, given Hydra's overrides and a seed."""


@dataclass(frozen=True)
class Job:
    """One run.

    Attributes:
        task: What has to be learned.
        method: What learns.
        config: Fingerprint of all settings.
        overrides: Hydra's overrides that choose them.
        seed: The run's seed.
        work: What makes the run.
    """

    task: str
    method: str
    config: str
    overrides: tuple[str, ...]
    seed: int
    work: Work

    @property
    def key(self) -> dict[str, str | int]:
        """What tells it from all other runs."""
        return {"task": self.task, "method": self.method, "seed": self.seed, "config": self.config}

    def run(self) -> Outcome:
        """Make the run."""
        return self.work(self.overrides, self.seed)


class RunLog:
    """The outcomes so far, one line of JSON each.

    Args:
        path: The file; it is made when there is something to write.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def read(self) -> dict[str, Outcome]:
        """The outcomes by key. A line that a kill cut short counts for nothing."""
        outcomes: dict[str, Outcome] = {}
        for line in self.path.read_text().splitlines() if self.path.exists() else []:
            try:
                record = json.loads(line)
            except json.JSONDecodeError:
                continue
            outcomes[_text(record["key"])] = record["outcome"]
        return outcomes

    def find(self, jobs: Iterable[Job]) -> dict[Job, Outcome]:
        """The outcomes of those jobs that are done."""
        outcomes = self.read()
        return {job: outcomes[_text(job.key)] for job in jobs if _text(job.key) in outcomes}

    def add(self, job: Job, outcome: Outcome) -> None:
        """Append a line, all at once."""
        line = json.dumps({"key": job.key, "outcome": outcome}) + "\n"
        file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        try:
            size = os.fstat(file).st_size
            if size and os.pread(file, 1, size - 1) != b"\n":  # what a kill cut short
                line = "\n" + line
            os.write(file, line.encode())
        finally:
            os.close(file)


def run_all(jobs: Iterable[Job], processes: int) -> Generator[tuple[Job, Outcome], None, None]:
    """Make runs, in any order, in processes of one torch thread each; yields what comes out as it does.

    Raises:
        BrokenProcessPool: If a process was killed.
    """
    executor = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), initializer=_begin)
    try:
        futures = {executor.submit(job.run): job for job in jobs}
        for future in as_completed(futures):
            yield futures[future], future.result()
        executor.shutdown()
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        for process in multiprocessing.active_children():
            process.terminate()
        raise


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C reaches all processes; only the first has to say so
    threading.Thread(target=_end_with_parent, daemon=True).start()
    torch.set_num_threads(1)


def _end_with_parent() -> None:
    """A parent that is killed outright cannot end its processes, and they would wait for work for ever."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _text(key: dict[str, str | int]) -> str:
    return json.dumps(key, sort_keys=True)
