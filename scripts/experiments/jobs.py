"""Many runs in several processes, each made once: what is in the log is not run again."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Generator, Hashable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

import torch

Outcome = dict[str, Any]
"""Results of a run: numbers, and lists of numbers for curves; ``solved`` is 0 or 1."""
Work = Callable[[Any, int], Outcome]
"""A function that makes one run, given its recipe and a seed."""


@dataclass(frozen=True)
class Job:
    """One run.

    Attributes:
        task: Name of the task.
        method: Name of the method that learns it.
        config: Fingerprint of all settings.
        recipe: First argument of the work, which chooses the settings: Hydra's overrides, for example.
        seed: Seed of the run.
        work: Function that makes the run.
    """

    task: str
    method: str
    config: str
    recipe: Hashable
    seed: int
    work: Work

    @property
    def cell(self) -> dict[str, str]:
        """The part of the key that runs share which differ in their seed only."""
        return {"task": self.task, "method": self.method, "config": self.config}

    @property
    def key(self) -> dict[str, str | int]:
        """The run's name in the log, different from all others."""
        return {"task": self.task, "method": self.method, "seed": self.seed, "config": self.config}

    def run(self) -> Outcome:
        """Make the run."""
        return self.work(self.recipe, self.seed)


Batch = tuple[Job, ...]
"""Runs of one cell that are made in one go."""


def batches(jobs: Iterable[Job], size: int) -> list[Batch]:
    """Jobs in batches of one cell each, the first of every cell before the second of any."""
    cells: dict[str, list[Job]] = {}
    for job in jobs:
        cells.setdefault(_text(job.cell), []).append(job)
    chunks = [[tuple(own[k : k + size]) for k in range(0, len(own), size)] for own in cells.values()]
    return [batch for same in zip_longest(*chunks) for batch in same if batch is not None]


class RunLog:
    """The outcomes so far, one line of JSON for each batch.

    A batch of one run has its seed in the key, and its outcome as it is. A larger one has a list of seeds in the key,
    and of each number a list with the values of all runs, so that quick runs need no line each.

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
            outcomes.update((_text(key), outcome) for key, outcome in _runs(record))
        return outcomes

    def find(self, jobs: Iterable[Job]) -> dict[Job, Outcome]:
        """The outcomes of those jobs that are done."""
        outcomes = self.read()
        return {job: outcomes[_text(job.key)] for job in jobs if _text(job.key) in outcomes}

    def add(self, batch: Batch, outcomes: Sequence[Outcome]) -> None:
        """Append a line, all at once."""
        record: dict[str, Any] = {"key": batch[0].key, "outcome": outcomes[0]}
        if len(batch) > 1:
            columns = {name: [outcome[name] for outcome in outcomes] for name in outcomes[0]}
            record = {"key": {**batch[0].cell, "seeds": [job.seed for job in batch]}, "outcomes": columns}
        line = json.dumps(record, separators=None if len(batch) == 1 else (",", ":")) + "\n"
        file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        try:
            size = os.fstat(file).st_size
            if size and os.pread(file, 1, size - 1) != b"\n":  # what a kill cut short
                line = "\n" + line
            os.write(file, line.encode())
        finally:
            os.close(file)


def run_all(todo: Iterable[Batch], processes: int) -> Generator[tuple[Batch, list[Outcome]], None, None]:
    """Make runs, in any order, in processes of one thread each; yields what comes out as it does.

    Raises:
        BrokenProcessPool: If a process was killed.
    """
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):  # read when a process loads NumPy
        os.environ.setdefault(name, "1")
    executor = ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), initializer=_begin)
    try:
        futures = {executor.submit(run_batch, batch): batch for batch in todo}
        for future in as_completed(futures):
            yield futures[future], future.result()
        executor.shutdown()
    except BaseException:
        executor.shutdown(wait=False, cancel_futures=True)
        for process in multiprocessing.active_children():
            process.terminate()
        raise


def run_batch(batch: Batch) -> list[Outcome]:
    """Make the runs of a batch, one after another."""
    return [job.run() for job in batch]


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


def _runs(record: dict[str, Any]) -> Iterator[tuple[dict[str, Any], Outcome]]:
    """The keys and outcomes of a line."""
    key = record["key"]
    if "seeds" not in key:
        yield key, record["outcome"]
        return
    cell = {name: value for name, value in key.items() if name != "seeds"}
    for k, seed in enumerate(key["seeds"]):
        yield {**cell, "seed": seed}, {name: column[k] for name, column in record["outcomes"].items()}


def _text(key: dict[str, Any]) -> str:
    return json.dumps(key, sort_keys=True)
