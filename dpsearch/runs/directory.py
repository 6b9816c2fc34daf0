"""A run's directory: the names of its files, and how a run is begun and found again."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml
from omegaconf import DictConfig, OmegaConf

from dpsearch.errors import RunError
from dpsearch.files import CHECKPOINT, atomic_write

DEEPEST = 30
"""Levels of a configuration's lists and mappings that are read."""


@dataclass(frozen=True)
class RunDirectory:
    """One run's directory.

    Attributes:
        path: Path of the directory.
    """

    path: Path

    @property
    def checkpoint(self) -> Path:
        """File with everything that the rest of the run depends on."""
        return self.path / CHECKPOINT

    @property
    def policy(self) -> Path:
        """File with the policy, for acting."""
        return self.path / "policy.pt"

    @property
    def metrics(self) -> Path:
        """File with one line of JSON for each update."""
        return self.path / "metrics.jsonl"

    @property
    def summary(self) -> Path:
        """File with the results of a finished run."""
        return self.path / "summary.json"

    @property
    def config(self) -> Path:
        """File with the run's configuration; as soon as it exists, the directory holds a run."""
        return self.path / ".hydra" / "config.yaml"

    @property
    def has_begun(self) -> bool:
        """Whether the run has learned anything yet."""
        return self.checkpoint.exists() or (self.metrics.exists() and self.metrics.stat().st_size > 0)

    @classmethod
    def named(cls, key: str, path: str) -> RunDirectory:
        """The directory that a setting names.

        Raises:
            RunError: If it names none.
        """
        if not path.strip():
            raise RunError(f"{key} must be the path of a directory, or null, got {path!r}")
        return cls(Path(path))

    @classmethod
    def free(cls, path: Path) -> RunDirectory:
        """The first of ``path``, ``path_2``, ``path_3``, ... that does not exist, made, so that nobody else takes it.

        Raises:
            RunError: If it cannot be made.
        """
        for name in chain([path], (path.with_name(f"{path.name}_{k}") for k in count(2))):
            try:
                name.mkdir(parents=True)
            except FileExistsError as error:
                if not os.path.lexists(name):  # a file has the name of a folder above
                    raise _cannot_write(name, error) from error
            except OSError as error:
                raise _cannot_write(name, error) from error
            else:
                return cls(name)
        raise AssertionError("there are more numbers than directories")

    def begin(self, config: DictConfig, hydra: Any) -> None:
        """Make the directory, and write the configuration there, as Hydra does.

        ``.hydra/`` is written beside its place and renamed, which succeeds for one process only.

        Args:
            config: Configuration of the run.
            hydra: Configuration of Hydra itself.

        Raises:
            RunError: If the directory holds a run already, or cannot be written.
        """
        taken = RunError(f"{self.path} already holds a run: give resume={self.path}, or another run_dir")
        if self.config.exists() or self.checkpoint.exists():
            raise taken
        for path in (self.policy, self.metrics, self.summary):
            if path.exists():
                raise RunError(f"{self.path} already holds a {path.name}, which would be lost: give another run_dir")
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            with TemporaryDirectory(prefix=".hydra.", dir=self.path, ignore_cleanup_errors=True) as beside:
                folder = Path(beside) / self.config.parent.name
                folder.mkdir()
                overrides = OmegaConf.create(list(hydra.overrides.task))
                own = OmegaConf.create({"hydra": hydra})
                for name, content in (("hydra", own), ("overrides", overrides), ("config", config)):
                    atomic_write(folder / f"{name}.yaml", OmegaConf.to_yaml(content, resolve=name == "config"))
                folder.rename(self.config.parent)
        except OSError as error:
            if self.config.exists():  # written by another process meanwhile
                raise taken from error
            raise _cannot_write(self.path, error) from error

    def read_config(self) -> tuple[DictConfig, dict[str, str]]:
        """The configuration of the run, and the option chosen of each config group.

        Raises:
            RunError: If there is no run here, or its files cannot be read.
        """
        if not self.config.is_file():
            raise RunError(f"there is no run in {self.path}: {self.config.relative_to(self.path)} is missing")
        try:
            config, hydra = (_read_yaml(self.config.with_name(f"{name}.yaml")) for name in ("config", "hydra"))
            return config, dict(hydra.hydra.runtime.choices)
        except Exception as error:  # YAML has errors of many kinds
            raise RunError(f"cannot read {self.config.parent}: {type(error).__name__}") from error

    def write_config(self, config: DictConfig) -> None:
        """Write the configuration."""
        atomic_write(self.config, OmegaConf.to_yaml(config, resolve=True))

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Write the results of the run.

        Raises:
            RunError: If a number is NaN or infinite, which JSON does not know.
        """
        try:
            text = json.dumps(summary, indent=2, allow_nan=False)
        except ValueError as error:
            raise RunError(f"cannot write {self.summary}: {error}") from error
        atomic_write(self.summary, text + "\n")


def _cannot_write(path: Path, error: OSError) -> RunError:
    return RunError(f"cannot write the run directory {path}: {error.strerror}")


def _read_yaml(path: Path) -> DictConfig:
    """A mapping, in plain YAML.

    What a few lines can make larger than any memory, or slower than any patience, is refused: aliases, and brackets
    within brackets without end.
    """
    text, depth = path.read_text(encoding="utf-8"), 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > DEEPEST or isinstance(event, yaml.AliasEvent):
            raise ValueError("an alias, or too deep")
    content = OmegaConf.create(text)
    assert isinstance(content, DictConfig)
    return content
