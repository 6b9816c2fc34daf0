"""``metrics.jsonl``: one line of JSON an update, cut back to the checkpoint when a run is resumed.

The numbers of a line come from ``Algorithm.update``; those of RPG's episodes from ``algos/rpg/source.py``.
"""

from __future__ import annotations

import json
import math
import os
import sys
import zlib
from pathlib import Path
from typing import BinaryIO

from dpsearch.errors import RunError


class MetricsFile:
    """The metrics file of a run under way; one process at a time may write it.

    Args:
        path: The file.
        updates: Number of updates whose lines are kept; later lines are cut off.
        checksum: CRC-32 that these lines must have; None to take them as they are.

    Attributes:
        checksum: CRC-32 of all lines so far.
        last: The last kept line; empty if none was kept.

    Raises:
        RunError: If the file has fewer lines than ``updates``, they are not those that the
            checksum is of, or another process is writing to the file.
    """

    def __init__(self, path: Path, updates: int, checksum: int | None = None) -> None:
        self._file: BinaryIO = open(path, "a+b", buffering=1 << 20)  # noqa: SIM115  # closed by close()
        try:
            _lock(self._file)
            self.last = self._cut(updates, checksum)
        except BaseException:
            self._file.close()
            raise

    def _cut(self, updates: int, checksum: int | None) -> dict[str, float | None]:
        self._file.seek(0)
        line, self.checksum = b"{}\n", 0
        for update in range(updates):
            line = self._file.readline()
            if not line.endswith(b"\n"):
                raise RunError(f"{self._file.name} ends at update {update}, before the checkpoint's {updates}")
            self.checksum = zlib.crc32(line, self.checksum)
        if checksum not in (None, self.checksum):
            raise RunError(f"{self._file.name} is damaged{self._damage(updates)}: it is not what the run wrote")
        last: dict[str, float | None] = json.loads(line)
        self._file.truncate(self._file.tell())
        return last

    def _damage(self, updates: int) -> str:
        """The damaged line, in words; empty if it cannot be told."""
        self._file.seek(0)
        for update in range(1, updates + 1):
            try:
                if json.loads(self._file.readline())["update"] != update:
                    return f" in line {update}"
            except (ValueError, KeyError, TypeError):
                return f" in line {update}"
        return ""

    def add(self, row: dict[str, float]) -> None:
        """Append the line of an update, with null for NaN and infinity; it reaches the disk sooner or later."""
        try:
            text = json.dumps(row, allow_nan=False)
        except ValueError:  # JSON has no such numbers
            text = json.dumps({name: value if math.isfinite(value) else None for name, value in row.items()})
        line = text.encode() + b"\n"
        self._file.write(line)
        self.checksum = zlib.crc32(line, self.checksum)

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
