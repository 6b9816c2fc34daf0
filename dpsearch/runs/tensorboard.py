"""TensorBoard curves: a point about every second, the mean over the updates since the last.

An update can take less than a millisecond, and to write a point of every curve takes about as long.
"""

from __future__ import annotations

import math
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from torch.utils.tensorboard import SummaryWriter

EVALUATION = ("evaluation/stochastic", "evaluation/greedy")


class TensorBoardLog:
    """The events of a run; the horizontal axis is environment steps.

    Args:
        path: The run's directory.
        hyperparameters: Values for the table; nested mappings of plain values.
        env_steps: Steps played so far; points of the log beyond them are disowned.
    """

    def __init__(self, path: Path, hyperparameters: dict[str, Any], env_steps: int) -> None:
        self._path = path
        self._hyperparameters = dict(_flat(hyperparameters))
        self._purge_step = env_steps + 1 if any(path.glob("events.out.tfevents.*")) else None
        self._writer: SummaryWriter | None = None
        self._sums: dict[str, float] = {}
        self._updates = 0
        self._steps, self._time = env_steps, perf_counter()

    def add(self, metrics: dict[str, float]) -> None:
        """Take an update's metrics into the next point."""
        sums = self._sums
        for name, value in metrics.items():
            sums[name] = sums.get(name, 0.0) + value
        self._updates += 1

    def write(self, env_steps: int, now: float) -> None:
        """Write the next point, if there was an update since the last.

        Args:
            env_steps: Steps played so far.
            now: Time by ``perf_counter`` (s).
        """
        if not self._updates:
            return
        values = {name: total / self._updates for name, total in self._sums.items()}
        values["steps_per_second"] = (env_steps - self._steps) / (now - self._time)
        for name, value in values.items():
            self._open().add_scalar(name, value, env_steps)
        self._sums, self._updates, self._steps, self._time = {}, 0, env_steps, now

    def write_evaluation(self, env_steps: int, stochastic: float, greedy: float) -> None:
        """Write the final evaluation of the policy."""
        writer = self._open()
        for name, value in zip(EVALUATION, (stochastic, greedy), strict=True):
            if math.isfinite(value):
                writer.add_scalar(name, value, env_steps)
        self._add_table(writer, end=True)

    def flush(self) -> None:
        """Hand all points over to the operating system, where a kill does not lose them."""
        if self._writer is not None:
            self._writer.flush()

    def close(self) -> None:
        """Write all remaining points."""
        if self._writer is not None:
            self._writer.close()

    def _open(self) -> SummaryWriter:
        """The writer, which is made as late as possible, for its import takes a while."""
        if self._writer is None:
            from torch.utils.tensorboard import SummaryWriter

            self._writer = SummaryWriter(str(self._path), purge_step=self._purge_step, flush_secs=10)
            self._add_table(self._writer, end=False)
        return self._writer

    def _add_table(self, writer: SummaryWriter, *, end: bool) -> None:
        """Write the run's row of the hyperparameter table: the values at the start, a mark of completion at the end.

        ``SummaryWriter.add_hparams`` would begin another run in a folder of its own.
        """
        from torch.utils.tensorboard.summary import hparams

        *start, finished = hparams(self._hyperparameters, dict.fromkeys(("return", *EVALUATION), 0.0))
        for summary in [finished] if end else start:
            writer._get_file_writer().add_summary(summary)


def _flat(values: dict[str, Any], prefix: str = "") -> list[tuple[str, bool | str | float]]:
    rows: list[tuple[str, bool | str | float]] = []
    for name, value in values.items():
        if isinstance(value, dict):
            rows += _flat(value, f"{prefix}{name}.")
        else:
            rows.append((prefix + name, value if isinstance(value, bool | str | float | int) else str(value)))
    return rows
