"""A run's directory: the names of its files, and how a run is begun and found again."""

from __future__ import annotations

import json
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from dpsearch.files import atomic_write
from dpsearch.runs.errors import RunError


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
        return self.path / "checkpoint.pt"

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
    def free(cls, path: Path) -> RunDirectory:
        """The first of ``path``, ``path_2``, ``path_3``, ... that does not exist."""
        names = chain([path], (path.with_name(f"{path.name}_{k}") for k in count(2)))
        return cls(next(name for name in names if not name.exists()))

    def begin(self, config: DictConfig, hydra: Any) -> None:
        """Make the directory, and write the configuration there, as Hydra does.

        Args:
            config: Configuration of the run.
            hydra: Configuration of Hydra itself.

        Raises:
            RunError: If the directory holds a run already, or cannot be written.
        """
        if self.config.exists() or self.checkpoint.exists():
            raise RunError(f"{self.path} already holds a run: give resume={self.path}, or another run_dir")
        for path in (self.policy, self.metrics, self.summary):
            if path.exists():
                raise RunError(f"{self.path} already holds a {path.name}, which would be lost: give another run_dir")
        try:
            self.config.parent.mkdir(parents=True, exist_ok=True)
            overrides = OmegaConf.create(list(hydra.overrides.task))
            for name, content in (("hydra", OmegaConf.create({"hydra": hydra})), ("overrides", overrides)):
                atomic_write(self.config.with_name(f"{name}.yaml"), OmegaConf.to_yaml(content))
            self.write_config(config)
        except OSError as error:
            raise RunError(f"cannot write the run directory {self.path}: {error.strerror}") from error

    def read_config(self) -> tuple[DictConfig, dict[str, str]]:
        """The configuration of the run, and the option chosen of each config group.

        Raises:
            RunError: If there is no run here, or its files cannot be read.
        """
        if not self.config.is_file():
            raise RunError(f"there is no run in {self.path}: {self.config.relative_to(self.path)} is missing")
        try:
            config = OmegaConf.load(self.config)
            hydra = OmegaConf.load(self.config.with_name("hydra.yaml"))
            assert isinstance(config, DictConfig)
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
