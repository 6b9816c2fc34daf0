"""Stored algorithms: ``checkpoint.pt`` read and rebuilt, with the environment that it knows.

``policy.pt``, which only acts, is read in ``runs/policy_file.py``.
"""

from __future__ import annotations

import dataclasses
import warnings
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

from dpsearch.files import CHECKPOINT, CheckpointError, other_versions, read_checkpoint
from dpsearch.policies import PolicyConfig
from dpsearch.rollout import EnvRecipe, EnvSource, Rollouts

UNFITTING = (AttributeError, IndexError, KeyError, OverflowError, RuntimeError, TypeError, ValueError)
"""Errors that settings and numbers raise which do not belong together."""


class Rebuildable(Protocol):
    """An algorithm that can be built from settings and a state."""

    config_type: ClassVar[type[Any]]

    def __init__(self, *, config: Any, policy: PolicyConfig, seed: int, **chosen: Any) -> None: ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Take the state."""


Rebuilt = TypeVar("Rebuilt", bound=Rebuildable)


@dataclass(frozen=True)
class StoredAlgorithm:
    """A checkpoint of an algorithm, read.

    Attributes:
        path: The file.
        content: What ``Algorithm.content`` gave, and what a run added.
    """

    path: Path
    content: dict[str, Any]

    @classmethod
    def read(cls, path: str | PathLike[str], algorithm: str) -> StoredAlgorithm:
        """Read a checkpoint.

        Args:
            path: The file, or the directory of a run.
            algorithm: Name of the algorithm that it must be of.

        Raises:
            CheckpointError: If it is missing, damaged, a policy alone, or of another algorithm.
        """
        path = Path(path)
        path = path / CHECKPOINT if path.is_dir() else path
        content = read_checkpoint(path)
        if "architecture" in content:
            raise CheckpointError(
                f"{path} holds a policy alone: give the directory of its run, or {CHECKPOINT} there; "
                "dpsearch.runs.load_policy reads a policy"
            )
        if content.get("algo") != algorithm:
            raise CheckpointError(f"{path} was saved by {content.get('algo')!r}, not by algorithm {algorithm!r}")
        return cls(path, content)

    def environment(
        self,
        env: EnvSource | Rollouts | None,
        env_kwargs: dict[str, Any] | None,
        threads: int,
        recipe: EnvRecipe | None,
    ) -> dict[str, Any]:
        """The arguments of ``Algorithm`` that say which environment; see ``Algorithm.load``.

        Raises:
            CheckpointError: If none is given and none is known, or it would import a module that is not ours.
            RunError: If the environment of the run cannot be made.
        """
        content = self.content
        if content["recipe"] is not None and env in (None, content["recipe"]["id"]):
            own = EnvRecipe(**content["recipe"])
            if env_kwargs is not None:
                own = dataclasses.replace(own, kwargs=env_kwargs)
            if env is None:
                self._check_known(own)
            return {"env": own.rollouts(threads=threads), "recipe": own}
        source = content["env"] if env is None else env
        if source is None:
            raise CheckpointError(f"{self.path} does not know its environment's id: give load(path, env=...)")
        if env is None:
            self._check_known(EnvRecipe(content["env"]))
        if isinstance(source, str) or (callable(source) and not isinstance(source, Rollouts)):
            saved = content["env_kwargs"] if content["recipe"] is None else content["recipe"]["kwargs"]
            kwargs = saved if env_kwargs is None else env_kwargs
            steps = content["max_episode_steps"]
            return {"env": source, "env_kwargs": kwargs, "max_episode_steps": steps, "threads": threads}
        return {"env": source, "env_kwargs": env_kwargs, "threads": threads, "recipe": recipe}

    def rebuild(self, make: type[Rebuilt], chosen: dict[str, Any]) -> Rebuilt:
        """The algorithm as it was saved, in a chosen environment, with a warning of other versions.

        Raises:
            CheckpointError: If it does not fit that environment, or this version has no such settings.
        """
        content = self.content
        try:
            config, policy = make.config_type(**content["config"]), PolicyConfig(**content["policy"])
        except UNFITTING as error:
            raise CheckpointError(f"{self.path} has settings that this version does not take: {error}") from error
        try:
            algorithm = make(config=config, policy=policy, seed=content["seed"], **chosen)
            algorithm.load_state_dict(content["state"])
        except UNFITTING as error:
            raise CheckpointError(f"{self.path} does not fit this environment: {str(error).splitlines()[0]}") from error
        if others := other_versions(content):
            warnings.warn(f"{self.path} was written with {others}: it may go on with other numbers", stacklevel=3)
        return algorithm

    def is_of(self, chosen: dict[str, Any]) -> bool:
        """Whether these arguments surely name the environment that the algorithm has learned in."""
        if chosen.get("recipe") is not None:
            return bool(self.content["recipe"] == dataclasses.asdict(chosen["recipe"]))
        env, kwargs = self.content["env"], self.content["env_kwargs"]
        return env is not None and (env, kwargs) == (chosen["env"], chosen["env_kwargs"])

    def _check_known(self, recipe: EnvRecipe) -> None:
        if recipe.stranger is not None:
            raise CheckpointError(
                f"{self.path} names environment {recipe.id!r}, for which module {recipe.stranger!r} would be imported: "
                f"if that is meant, give env={recipe.id!r}"
            )
