"""The provenance of numbers: the command and the machine."""

from __future__ import annotations

import os
import platform
import shlex
from collections.abc import Sequence
from pathlib import Path


def command(script: str, arguments: Sequence[str]) -> str:
    """The command line that computes the numbers again, in a checkout."""
    return shlex.join(["python", script, *arguments])


def machine() -> str:
    """The processor and its number of cores."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                model = line.partition(":")[2].strip()
                break
    return f"{model}, {os.cpu_count()} cores"
