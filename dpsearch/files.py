"""Files that are written whole or not at all; and checkpoints, whose content is checked when they are read."""

from __future__ import annotations

import dataclasses
import os
import platform
from collections import OrderedDict
from collections.abc import Mapping
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, ZipFile

import numpy as np
import torch

from dpsearch import __version__

FORMAT = 6
"""Raise it whenever the content of ``checkpoint.pt`` or ``policy.pt`` changes: older files are then refused.

The content is put together by ``Algorithm.content`` (read in ``algos/stored.py``) and ``runs/policy_file.py``.
"""
CHECKPOINT = "checkpoint.pt"
"""Name of the checkpoint in a run's directory."""

_PLAIN = (type(None), bool, int, float, str)


class CheckpointError(RuntimeError):
    """A checkpoint cannot be read or does not fit."""


def atomic_write(path: str | os.PathLike[str], content: bytes | str) -> None:
    """Write a file beside its place and rename it, so that a kill or a full disk never leaves half of one.

    Raises:
        OSError: If the folder is missing or not writable, or the disk is full; a file that was there is left alone.
    """
    path = Path(path)
    beside = path.with_name(f".{path.name}.part")
    try:
        with open(beside, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    except OSError:
        beside.unlink(missing_ok=True)
        raise


def plain(value: Any, name: str) -> Any:
    """A setting's value as a checkpoint can hold it: NumPy's numbers and arrays become Python's, paths strings.

    Args:
        value: The value; of dataclasses, dicts, lists and tuples, each entry is treated alike.
        name: Name of the setting, for the error message.

    Raises:
        ValueError: If it is, or contains, anything else.
    """
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if type(value) in _PLAIN:
        return value
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        given = [field.name for field in dataclasses.fields(value) if field.init]
        return dataclasses.replace(value, **{field: plain(getattr(value, field), field) for field in given})
    if isinstance(value, Mapping):
        return {plain(key, name): plain(entry, f"{name}.{key}") for key, entry in value.items()}
    if isinstance(value, list | tuple):
        entries = [plain(entry, f"{name}[{k}]") for k, entry in enumerate(value)]
        return entries if isinstance(value, list) else tuple(entries)
    raise ValueError(
        f"{name} must be made of numbers, strings, lists and dicts, which a checkpoint can hold, got an object of type "
        f"{type(value).__name__!r}"
    )


def versions() -> dict[str, str]:
    """Versions of what a run depends on."""
    packages = {name: version(name) for name in ("torch", "numpy", "gymnasium", "numba")}
    return {"python": platform.python_version(), "dpsearch": __version__, **packages}


def other_versions(content: Mapping[str, Any]) -> str:
    """The packages, but for Python, that a checkpoint was written with in other versions; empty if there are none."""
    now, then = versions(), content["versions"]
    return ", ".join(
        f"{name} {then.get(name)} (here {now[name]})"
        for name in now
        if name != "python" and then.get(name) != now[name]
    )


def write_checkpoint(path: str | os.PathLike[str], content: dict[str, Any]) -> None:
    """Write tensors, numbers, strings and containers of these, atomically; a missing folder is made.

    Raises:
        CheckpointError: If something in it is of another kind, and could not be read again.
        OSError: If the folder cannot be made or written.
    """
    path = Path(path)
    _check_readable(content, path.name)
    buffer = BytesIO()
    torch.save({"format": FORMAT, "versions": versions(), **content}, buffer)
    path.parent.mkdir(parents=True, exist_ok=True)
    atomic_write(path, buffer.getvalue())


def read_checkpoint(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read what ``write_checkpoint`` wrote; nothing in the file is executed.

    Raises:
        CheckpointError: If there is no such file, or it cannot be read, is damaged or of another format.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except (FileNotFoundError, NotADirectoryError, IsADirectoryError) as error:
        raise CheckpointError(f"no checkpoint at {path}: {error.strerror}") from error
    except OSError as error:
        raise CheckpointError(f"cannot read {path}: {error.strerror}") from error
    try:
        _check_archive(data)
        content = torch.load(BytesIO(data), weights_only=True)
    except Exception as error:
        raise CheckpointError(f"{path} is damaged, truncated or not a checkpoint ({type(error).__name__})") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise CheckpointError(f"{path} is not a dpsearch checkpoint of format {FORMAT}, which this version reads")
    return content


def _check_readable(content: Any, name: str) -> None:
    """Raise a CheckpointError that names the first entry that ``torch.load`` would not read with ``weights_only``."""
    if type(content) in (dict, OrderedDict):
        for key, entry in content.items():
            _check_readable(key, name)
            _check_readable(entry, f"{name}: {key}")
    elif type(content) in (list, tuple):
        for entry in content:
            _check_readable(entry, name)
    elif type(content) not in (*_PLAIN, torch.Tensor, torch.nn.Parameter):
        raise CheckpointError(f"{name} is of type {type(content).__name__!r}, which a checkpoint cannot hold")


def _check_archive(data: bytes) -> None:
    """Compare the checksum of every part of a checkpoint, which is a ZIP archive; ``torch.load`` does not.

    Raises:
        ValueError: If a part is damaged, or compressed, which none that is ours is.
    """
    with ZipFile(BytesIO(data)) as archive:
        if any(part.compress_type != ZIP_STORED for part in archive.infolist()):
            raise ValueError("a part is compressed")
        damaged = archive.testzip()
    if damaged is not None:
        raise ValueError(f"{damaged} is damaged")
