"""Checkpoints: one file, written beside its place and then renamed, so that a kill never leaves half of one."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Any

import torch

from dpsearch import __version__

FORMAT = 5


class CheckpointError(RuntimeError):
    """A checkpoint cannot be read or does not fit."""


def versions() -> dict[str, str]:
    """Versions of what a run depends on."""
    packages = {name: version(name) for name in ("torch", "numpy", "gymnasium", "numba")}
    return {"python": platform.python_version(), "dpsearch": __version__, **packages}


def write_checkpoint(path: str | os.PathLike[str], content: dict[str, Any]) -> None:
    """Write tensors, numbers, strings and containers of these, atomically.

    Raises:
        CheckpointError: If something in it is of another kind, and could not be read again.
        OSError: If the folder is missing or not writable.
    """
    path = Path(path)
    buffer = BytesIO()
    try:
        torch.save({"format": FORMAT, "versions": versions(), **content}, buffer)
        buffer.seek(0)
        torch.load(buffer, weights_only=True)
    except Exception as error:
        raise CheckpointError(f"{path} would not be readable: {str(error).splitlines()[0]}") from error
    beside = path.with_name(f".{path.name}.part")
    with open(beside, "wb") as file:
        file.write(buffer.getbuffer())
        file.flush()
        os.fsync(file.fileno())
    os.replace(beside, path)


def read_checkpoint(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read what ``write_checkpoint`` wrote; nothing in the file is executed.

    Raises:
        CheckpointError: If there is no such file, or it is truncated, corrupt or of another format.
    """
    path = Path(path)
    if not path.is_file():
        raise CheckpointError(f"no checkpoint at {path}")
    try:
        content = torch.load(path, weights_only=True)
    except Exception as error:
        raise CheckpointError(f"{path} is truncated or not a checkpoint ({type(error).__name__})") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise CheckpointError(f"{path} is not a dpsearch checkpoint of format {FORMAT}, which this version reads")
    return content
