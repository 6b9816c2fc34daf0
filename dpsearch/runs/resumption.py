"""The check before a run goes on: its settings are those that the checkpoint was made with."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from dpsearch.errors import RunError
from dpsearch.files import read_checkpoint
from dpsearch.runs.directory import RunDirectory


def check_unchanged(directory: RunDirectory, settings: Mapping[str, Any]) -> int:
    """Compare the settings that a run is to go on with, with those that its checkpoint was made with.

    Args:
        directory: Directory of the run.
        settings: Settings from ``.hydra/config.yaml``, as ``Run`` takes them.

    Returns:
        The checksum of the metrics up to the checkpoint; see ``MetricsFile``.

    Raises:
        CheckpointError: If the checkpoint cannot be read.
        RunError: If a setting differs, or the checkpoint is not of a run.
    """
    content = read_checkpoint(directory.checkpoint)
    if "run" not in content:
        raise RunError(f"{directory.checkpoint} was not written by a run, so there is none to resume")
    before, now = dict(_flat(content["run"]["settings"])), dict(_flat(settings))
    for name in (*before, *now):
        if before.get(name) != now.get(name):
            raise RunError(
                f"{name} is {now.get(name)!r} in {directory.config}, but the checkpoint was made with "
                f"{before.get(name)!r}, which cannot be changed: put it back"
            )
    checksum: int = content["run"]["metrics"]
    return checksum


def _flat(settings: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Full names and values of nested settings."""
    if not isinstance(settings, Mapping) or not settings:
        yield name, settings
        return
    for key, value in settings.items():
        yield from _flat(value, f"{name}.{key}" if name else str(key))
