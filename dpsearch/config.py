"""The configuration: dataclasses say which settings there are, of what type, with which default and meaning.

Those of an algorithm stand beside it, those of a search or an environment in the signature and the docstring of its
class, the rest here. YAML files hold what differs from the defaults, by choice of ``algo``, ``env`` and ``experiment``:

::

    compose(overrides)           Hydra: YAML files and overrides, unchecked
    completed(config, choices)   every setting, with its default and its type
    checked(config)              objects, in range

Ranges are checked where the values are used, or in ``__post_init__`` here; either way before anything is written.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields
from difflib import get_close_matches
from pathlib import Path
from typing import Any, ClassVar

import hydra
from hydra.core.config_store import ConfigStore
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import MISSING, DictConfig, OmegaConf, open_dict
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

from dpsearch.algos import ALGORITHMS
from dpsearch.algos.baselines import left_behind
from dpsearch.algos.settings import require
from dpsearch.options import dataclass_of
from dpsearch.policies import PolicyConfig
from dpsearch.pomdp.file_format.reader import read_discount
from dpsearch.pomdp.file_format.tokens import PomdpFileError
from dpsearch.renamed import renaming
from dpsearch.runs import EnvRecipe, RunError


@dataclass
class EnvConfig:
    """An environment. A subclass adds the arguments of the environment's class.

    Attributes:
        id: Gymnasium's id; what precedes a colon is a module to import first.
        gamma: Discount factor of the task, which algorithms take unless told otherwise.
        max_episode_steps: Step limit of an episode; null leaves it to the environment.
        reward_threshold: Mean return that counts as solved; null for the environment's own.
        arguments: Names of the fields that are arguments of the environment.
        paths: Names of the arguments that name files.
    """

    id: str = MISSING
    gamma: float = MISSING
    max_episode_steps: int | None = None
    reward_threshold: float | None = None
    arguments: ClassVar[Collection[str]] = ()
    paths: ClassVar[Collection[str]] = ()

    def __post_init__(self) -> None:
        """Raise a ValueError that names the key if a value is out of range."""
        if self.reward_threshold is not None and not math.isfinite(self.reward_threshold):
            raise ValueError(f"reward_threshold must be finite, got {self.reward_threshold}")

    def recipe(self) -> EnvRecipe:
        """The recipe by which the environment is made."""
        kwargs = {name: getattr(self, name) for name in sorted(self.arguments)}
        limit = None if "max_episode_steps" in kwargs else self.max_episode_steps
        return EnvRecipe(self.id, kwargs, max_episode_steps=limit, reward_threshold=self.reward_threshold)


@dataclass
class GymConfig(EnvConfig):
    """Any Gymnasium environment.

    Attributes:
        kwargs: Arguments of the environment.
        observe_only: Components of the observation that the policy sees; null for all.
    """

    kwargs: dict[str, Any] = field(default_factory=dict)
    observe_only: list[int] | None = None

    def recipe(self) -> EnvRecipe:
        """The recipe by which the environment is made."""
        return EnvRecipe(self.id, self.kwargs, self.observe_only, self.max_episode_steps, self.reward_threshold)


def env_config(env_id: str) -> type[EnvConfig]:
    """The settings of an environment: those that all have, and the arguments of its class.

    Args:
        env_id: Gymnasium's id; what precedes a colon is a module to import first.

    Raises:
        RunError: If there is no such environment.
    """
    recipe = EnvRecipe(env_id)
    options = recipe.options()
    namespace = {
        "__doc__": f"The environment {env_id}.",
        "arguments": [option.name for option in options],
        "paths": [option.name for option in options if option.is_path],
    }
    return dataclass_of(f"{recipe.name}Config", options, EnvConfig, missing=MISSING, namespace=namespace)


MOST_THREADS, MOST_ENVS = 1024, 65_536  # no system gives more threads, no memory takes more environments


@dataclass
class RolloutConfig:
    """Settings of the engine that plays episodes.

    Attributes:
        threads: Threads that play environments with a compiled kernel; results do not depend on it.
        num_envs: Environments without a compiled kernel that are played side by side; null for 32.
        on_error: An environment that raises, or shows what is not a finite number of the right shape, ends the run
            ("raise"), or its episode is played again with another seed ("retry").
    """

    threads: int = 1
    num_envs: int | None = None
    on_error: str = "raise"

    def __post_init__(self) -> None:
        """Raise a ValueError that names the key if a value is out of range."""
        for name, most in (("threads", MOST_THREADS), ("num_envs", MOST_ENVS)):
            number = getattr(self, name)
            if number is not None and not 1 <= number <= most:
                raise ValueError(f"{name} must be at least 1 and at most {most}, got {number}")
        if self.on_error not in ("raise", "retry"):
            raise ValueError(f"on_error must be raise or retry, got {self.on_error}")


@dataclass
class TrainConfig:
    """A run.

    Attributes:
        algo: Settings of the algorithm.
        env: The environment.
        policy: Architecture of the policy.
        rollout: Settings of the engine that plays episodes.
        seed: Seed of everything random, in [0, 2**64).
        run_dir: Directory of the run; null for ``runs/<algorithm>/<environment>/<time>_seed<seed>``.
        resume: Directory of a run to go on with.
        until_solved: Stop once 100 evaluation episodes reach the environment's reward threshold, if it has one.
        total_steps: Environment steps after which to stop.
        total_episodes: Episodes after which to stop.
        total_updates: Updates after which to stop.
        evaluation_episodes: Episodes played in the end, to measure what the policy achieves.
        checkpoint_seconds: Time from one checkpoint to the next (s); results do not depend on it.
        progress: Whether to show progress.
    """

    algo: Any = MISSING
    env: EnvConfig = MISSING
    policy: PolicyConfig = field(default_factory=PolicyConfig)
    rollout: RolloutConfig = field(default_factory=RolloutConfig)
    seed: int = 0
    run_dir: str | None = None
    resume: str | None = None
    until_solved: bool = True
    total_steps: int | None = 10_000_000
    total_episodes: int | None = None
    total_updates: int | None = None
    evaluation_episodes: int = 100
    checkpoint_seconds: float = 30.0
    progress: bool = True

    def __post_init__(self) -> None:
        """Raise a ValueError that names the key if a value is out of range."""
        accepted = {
            "seed": (0 <= self.seed < 2**64, "in [0, 2**64)"),
            "evaluation_episodes": (2 <= self.evaluation_episodes <= 2**24, "at least 2 and at most 2**24"),
            "checkpoint_seconds": (self.checkpoint_seconds > 0.0, "positive"),
        }
        for name in ("total_steps", "total_episodes", "total_updates"):
            accepted[name] = (getattr(self, name) is None or getattr(self, name) >= 1, "at least 1, or null")
        require(self, accepted)


SECTIONS = ("algo", "env", "policy", "rollout")
"""Settings of a run that have settings of their own."""

RESUMABLE = frozenset(
    {
        "resume",
        "until_solved",
        "total_steps",
        "total_episodes",
        "total_updates",
        "rollout.threads",
        "rollout.on_error",
        "checkpoint_seconds",
        "progress",
    }
)
"""The keys that may be given when a run is resumed: none of them changes what an update does that does not fail."""


def register() -> None:
    """Tell Hydra which settings a run has, and OmegaConf what some files of ``configs`` compute.

    Hydra refuses settings that it does not know. Those of a section depend on what is chosen for the others, so each
    section is open while the configuration is composed, and checked once it is: ``completed``.
    """
    OmegaConf.register_new_resolver("pomdp_discount", _pomdp_discount, replace=True)
    run = OmegaConf.to_container(OmegaConf.structured(TrainConfig))
    assert isinstance(run, dict)
    node = OmegaConf.create({**run, **{section: {} for section in SECTIONS}})
    for section in SECTIONS:
        OmegaConf.set_struct(node[section], False)
    ConfigStore.instance().store(name="settings", node=node)


def _pomdp_discount(*, _parent_: DictConfig) -> float:
    """The discount factor in the file that ``path`` names; 1 if there is none, for the environment to refuse it."""
    try:
        return 1.0 if OmegaConf.is_missing(_parent_, "path") else read_discount(_parent_.path)
    except PomdpFileError:
        return 1.0


def compose(overrides: Sequence[str]) -> tuple[DictConfig, dict[str, str]]:
    """The configuration of ``train.py OVERRIDES``, unchecked, and the option chosen of each group.

    Args:
        overrides: Choices and settings, in Hydra's way: ``env=tiger``, ``algo.gamma=0.9``.

    Raises:
        HydraException: If a group has no such option, or a run no such setting.
    """
    register()
    with hydra.initialize_config_module("dpsearch.configs", version_base="1.3"):
        config = hydra.compose("train", list(overrides), return_hydra_config=True)
    choices = dict(config.hydra.runtime.choices)
    with open_dict(config):
        del config["hydra"]
    return config, choices


def completed(config: DictConfig, choices: Mapping[str, str], overrides: Sequence[str] = ()) -> DictConfig:
    """A configuration with every setting of the run, each of its type; those that name files are absolute.

    Args:
        config: The composed configuration, or a saved one. Settings of another baseline than the one chosen, which
            remain where files or overrides choose it anew, are dropped from it.
        choices: The option chosen of each group.
        overrides: The user's own, whose settings are kept, to be refused if they do not fit.

    Raises:
        RunError: If there is no such algorithm, environment or setting.
        OmegaConfBaseException: If a value is of the wrong type.
    """
    if choices["algo"] not in ALGORITHMS:
        raise RunError(f"algo must be one of {', '.join(ALGORITHMS)}, got {choices['algo']}")
    env_id = OmegaConf.select(config, "env.id")
    if env_id is not None and not isinstance(env_id, str):
        raise RunError(f"env.id must be the id of an environment, got {env_id!r}")
    env = GymConfig if choices["env"] == "gym" or env_id is None else env_config(env_id)
    kinds = {"algo": ALGORITHMS[choices["algo"]].config_type, "env": env}
    _settle_baseline(config, overrides)
    given = OmegaConf.to_container(config)
    assert isinstance(given, dict)
    _refuse_unknown(given, TrainConfig)
    for section, kind in {**kinds, "policy": PolicyConfig, "rollout": RolloutConfig}.items():
        if not isinstance(given[section], dict):
            raise RunError(f"{section} must be settings, got {given[section]!r}")
        _refuse_unknown(given[section], kind, section)
    typed = OmegaConf.merge(OmegaConf.structured(TrainConfig), kinds, given)
    assert isinstance(typed, DictConfig)
    for name in env.paths:  # a run can be resumed, and its policy played, from anywhere
        if not OmegaConf.is_missing(typed.env, name):
            typed.env[name] = str(Path(typed.env[name]).absolute())
    return typed


def _refuse_unknown(given: Mapping[Any, Any], kind: type[Any], section: str = "") -> None:
    for name, value in given.items():
        if name not in (names := [setting.name for setting in fields(kind)]):
            raise RunError(unknown(str(name), names, section))
        if words := renaming(f"{section}.{name}={value}"):
            raise RunError(words)


def unknown(name: str, names: Sequence[str], section: str = "") -> str:
    """The error message for a setting that does not exist.

    Args:
        name: The name given.
        names: The settings that exist.
        section: Section it was given in; empty for the run itself.
    """
    where = f"{section}." if section else ""
    if words := renaming(f"{where}{name}"):
        return words
    similar = get_close_matches(name, names, n=1)
    hint = f"did you mean {similar[0]}?" if similar else f"there are {', '.join(names)}"
    return f"{where}{name} is not a setting{f' of {section}' if section else ''}: {hint}"


def checked(config: DictConfig) -> TrainConfig:
    """A completed configuration as objects.

    Args:
        config: The configuration, as ``completed`` makes it.

    Raises:
        RunError: If a value is out of range or missing.
        OmegaConfBaseException: If a value cannot be computed.
    """
    for section in SECTIONS:  # one by one, to name the one that is wrong
        checked_section(config, section)
    settings = _object(config)
    assert isinstance(settings, TrainConfig)
    return settings


def checked_section(config: DictConfig, section: str) -> Any:
    """A section of a completed configuration as an object; raises what ``checked`` does."""
    return _object(config[section], f"{section}.")


def _object(config: DictConfig, prefix: str = "") -> Any:
    try:
        return OmegaConf.to_object(config)
    except MissingMandatoryValue as error:
        raise RunError(f"{error.full_key} must be given") from None
    except OmegaConfBaseException:
        raise
    except ValueError as error:
        raise RunError(f"{prefix}{error}") from error


def _settle_baseline(config: DictConfig, overrides: Sequence[str]) -> None:
    """Make ``algo.baseline`` what the user chose: a kind, with settings of the user's own or of files for that kind."""
    mine = [o for o in OverridesParser.create().parse_overrides(list(overrides)) if not o.is_delete()]
    given: dict[str, Any] = {o.key_or_group: o.value() for o in mine if o.key_or_group.startswith("algo.baseline.")}
    whole = [o.value() for o in mine if o.key_or_group == "algo.baseline"]
    if given and whole and isinstance(whole[-1], str):  # the one has overwritten the other
        OmegaConf.update(config, "algo.baseline", {"kind": whole[-1]}, merge=False)
        for key, value in given.items():
            OmegaConf.update(config, key, value)
    baseline = OmegaConf.select(config, "algo.baseline")
    if isinstance(baseline, DictConfig) and "kind" in baseline:
        names = {key.removeprefix("algo.baseline.") for key in given}
        names |= {str(name) for value in whole if isinstance(value, dict) for name in value}
        for name in left_behind({str(key): baseline[key] for key in baseline}, names):
            del baseline[name]
