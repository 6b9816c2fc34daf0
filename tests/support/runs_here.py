"""Runs of experiments made in this process, one by one, instead of in processes of their own."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import pytest

from scripts import reproduce
from scripts.experiments.jobs import Batch, Outcome, run_batch


def make_runs_here(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Have ``reproduce.py`` make its runs here; the list grows by the task and method of every run that is made."""
    made: list[str] = []

    def one_by_one(todo: Iterable[Batch], processes: int) -> Iterator[tuple[Batch, list[Outcome]]]:
        for batch in todo:
            made.extend(f"{job.task}: {job.method}" for job in batch)
            yield batch, run_batch(batch)

    monkeypatch.setattr(reproduce, "run_all", one_by_one)
    return made
