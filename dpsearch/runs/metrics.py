"""``metrics.jsonl``: one line of JSON an update, cut back to the checkpoint when a run is resumed."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import BinaryIO

from dpsearch.errors import RunError


class MetricsFile:
    """The metrics file of a run under way; one process at a time may write it.

    Args:
        path: The file.
        updates: Number of updates whose lines are kept; later lines are cut off.

    Attributes:
        last: The last kept line; empty if none was kept.

    Raises:
        RunError: If the file has fewer lines than ``updates``, or another process is writing to the file.
    """

    def __init__(self, path: Path, updates: int) -> None:
        self._file: BinaryIO = open(path, "a+b", buffering=1 << 20)  # noqa: SIM115  # closed by close()
        try:
            _lock(self._file)
            self.last: dict[str, float] = self._cut(updates)
        except BaseException:
            self._file.close()
            raise

    def _cut(self, updates: int) -> dict[str, float]:
        self._file.seek(0)
        line = b"{}\n"
        for update in range(updates):
            line = self._file.readline()
            if not line.endswith(b"\n"):
                raise RunError(f"{self._file.name} ends at update {update}, before the checkpoint's {updates}")
        self._file.truncate(self._file.tell())
        last: dict[str, float] = json.loads(line)
        return last

    def add(self, row: dict[str, float]) -> None:
        """Append one update's line; a kill before ``flush`` may lose it."""
        self._file.write(json.dumps(row).encode() + b"\n")

    def flush(self) -> None:
        """Hand all lines over to the operating system, where a kill does not lose them."""
        self._file.flush()

    def sync(self) -> None:
        """Make sure that all lines are on disk: a checkpoint counts on them."""
        self._file.flush()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Write all remaining lines, and release the file for other processes."""
        self._file.close()


def _lock(file: BinaryIO) -> None:
    """Keep other processes from writing, until the file is closed or this process ends, however it ends."""
    if sys.platform == "win32":
        return
    import fcntl

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise RunError(f"another process is at work on {file.name}") from error
    except OSError:  # a file system that knows no locks
        return
