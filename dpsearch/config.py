"""The configuration's schema: dataclasses say which keys there are and of what type, YAML files give the values.

Only what algorithms and policies take has defaults of its own, since they are used without configuration files too.

An option of a config group is named after its schema: ``configs/env/tmaze.yaml`` is checked against ``ENVS["tmaze"]``.
Ranges are checked where the values are used, or in ``__post_init__`` here; either way before anything is written.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import MISSING, DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from dpsearch.algos import ALGORITHMS
from dpsearch.algos.settings import require
from dpsearch.policies import PolicyConfig
from dpsearch.pomdp.file_format.reader import read_discount
from dpsearch.pomdp.file_format.tokens import PomdpFileError
from dpsearch.runs import EnvRecipe, RunError


@dataclass
class EnvConfig:
    """An environment. Keys that a subclass adds are arguments of the environment, unless it says otherwise.

    Attributes:
        id: Gymnasium's id; what precedes a colon is a module to import first.
        gamma: The task's own discount factor, which algorithms take unless told otherwise.
        max_episode_steps: Step limit of an episode; null leaves it to the environment.
        reward_threshold: Mean return that counts as solved; null for the registered one.
    """

    id: str = MISSING
    gamma: float = MISSING
    max_episode_steps: int | None = None
    reward_threshold: float | None = None

    def __post_init__(self) -> None:
        """Raise a ValueError that names the key if a value is out of range."""
        if self.reward_threshold is not None and not math.isfinite(self.reward_threshold):
            raise ValueError(f"reward_threshold must be finite, got {self.reward_threshold}")

    def recipe(self) -> EnvRecipe:
        """How to make the environment."""
        own = {f.name for f in fields(self)} - {"id", "gamma", "reward_threshold"}
        kwargs = {name: getattr(self, name) for name in sorted(own)}
        return EnvRecipe(self.id, kwargs, reward_threshold=self.reward_threshold)


@dataclass
class TMazeConfig(EnvConfig):
    """The T-maze; see ``dpsearch.envs.TMaze``."""

    corridor_length: int = MISSING
    encoding: str = MISSING
    wrong_turn_reward: float = MISSING


@dataclass
class PolesConfig(EnvConfig):
    """Pole balancing, all four tasks; see ``dpsearch.envs.DoublePole``.

    Attributes:
        reward: "steps", "failure" or "damping".
        start_state: Numbers, rows of numbers or "generalisation"; null for the usual start.
        cart_friction: Force in N that brakes a moving cart.
    """

    reward: str = MISSING
    start_state: Any = None
    cart_friction: float = MISSING


@dataclass
class TigerConfig(EnvConfig):
    """The Tiger problem; see ``dpsearch.envs.Tiger``."""

    single: bool = MISSING


@dataclass
class CheeseMazeConfig(EnvConfig):
    """The cheese maze; see ``dpsearch.envs.CheeseMaze``."""

    start: str = MISSING
    bump_reward: float = MISSING


@dataclass
class Maze4x3Config(EnvConfig):
    """The 4x3 maze; see ``dpsearch.envs.Maze4x3``."""

    minus_ends: bool = MISSING
    slips: str = MISSING
    minus_reward: float = MISSING


@dataclass
class DrivingConfig(EnvConfig):
    """Driving; see ``dpsearch.envs.driving.rules``.

    Attributes:
        speed_profile: Start and end in km/h (2 to 400) and the seconds between; one speed; null for pedals.
        observations: Names of what is seen.
        lookahead: Base (m) and gain (s) of the look-ahead distance.
        start: "line" or "random".
        control_hz: Steps a second.
        stuck_seconds: Time off the road or standing after which an episode is over.
        reward: What a step on the road pays: speed; progress, the speed along the road; or centred, that times
            1 - position^2.
    """

    speed_profile: Any = MISSING
    observations: list[str] = MISSING
    lookahead: list[float] = MISSING
    start: str = MISSING
    control_hz: float = MISSING
    stuck_seconds: float = MISSING
    reward: str = MISSING


@dataclass
class TrackConfig(DrivingConfig):
    """Driving on a track of our own; see ``dpsearch.envs.Track``.

    Attributes:
        track: A seed, a name or a list of segments.
        width: Of the road (m).
    """

    track: Any = MISSING
    width: float = MISSING


@dataclass
class TorcsConfig(DrivingConfig):
    """Driving in TORCS; see ``dpsearch.envs.TORCS``.

    Attributes:
        track: Name of the track.
        car: Name of the car.
    """

    track: str = MISSING
    car: str = MISSING


@dataclass
class PomdpConfig(EnvConfig):
    """A finite POMDP from a file; see ``dpsearch.envs.POMDP``.

    Attributes:
        path: The file.
        file: The same, absolute, for whoever goes on with the run or plays its policy elsewhere.
    """

    path: str = MISSING
    file: str = MISSING

    def recipe(self) -> EnvRecipe:
        """How to make the environment."""
        kwargs = {"max_episode_steps": self.max_episode_steps, "path": self.file}
        return EnvRecipe(self.id, kwargs, reward_threshold=self.reward_threshold)


@dataclass
class GymConfig(EnvConfig):
    """Any Gymnasium environment.

    Attributes:
        kwargs: Arguments of the environment.
        observe_only: The components of the observation that the policy sees; null for all.
    """

    kwargs: dict[str, Any] = field(default_factory=dict)
    observe_only: list[int] | None = None

    def recipe(self) -> EnvRecipe:
        """How to make the environment."""
        return EnvRecipe(self.id, self.kwargs, self.observe_only, self.max_episode_steps, self.reward_threshold)


MOST_THREADS, MOST_ENVS = 1024, 65_536  # no system gives more threads, no memory takes more environments


@dataclass
class RolloutConfig:
    """How episodes are played.

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
    """All of a run.

    Attributes:
        algo: The algorithm's own config.
        env: The environment.
        policy: The policy's architecture.
        rollout: How episodes are played.
        seed: Of everything random, in [0, 2**64).
        run_dir: Where the run is kept; null for ``runs/<algorithm>/<environment>/<time>_seed<seed>``.
        resume: Directory of a run to go on with.
        until_solved: Stop once 100 evaluation episodes reach the environment's reward threshold, if it has one.
        total_steps: Environment steps after which to stop.
        total_episodes: Episodes after which to stop.
        total_updates: Updates after which to stop.
        evaluation_episodes: Episodes that say in the end what the policy achieves.
        checkpoint_seconds: Time from one checkpoint to the next; results do not depend on it.
        progress: Whether to show progress.
    """

    algo: Any = MISSING
    env: EnvConfig = MISSING
    policy: PolicyConfig = field(default_factory=PolicyConfig)
    rollout: RolloutConfig = field(default_factory=RolloutConfig)
    seed: int = MISSING
    run_dir: str | None = MISSING
    resume: str | None = MISSING
    until_solved: bool = MISSING
    total_steps: int | None = MISSING
    total_episodes: int | None = MISSING
    total_updates: int | None = MISSING
    evaluation_episodes: int = MISSING
    checkpoint_seconds: float = MISSING
    progress: bool = MISSING

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


ENVS: dict[str, type[EnvConfig]] = {
    "cheese": CheeseMazeConfig,
    "double_pole": PolesConfig,
    "double_pole_hidden": PolesConfig,
    "gym": GymConfig,
    "maze4x3": Maze4x3Config,
    "maze89": EnvConfig,
    "pomdp": PomdpConfig,
    "shuttle": EnvConfig,
    "single_pole": PolesConfig,
    "single_pole_hidden": PolesConfig,
    "tiger": TigerConfig,
    "tmaze": TMazeConfig,
    "torcs": TorcsConfig,
    "track": TrackConfig,
}
ALGOS: dict[str, type[Any]] = {name: algorithm.config_type for name, algorithm in ALGORITHMS.items()}

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
    """Tell Hydra about the schemas, and OmegaConf what some files of ``configs`` compute."""
    OmegaConf.register_new_resolver("pomdp_file", _pomdp_file, replace=True)
    OmegaConf.register_new_resolver("pomdp_discount", _pomdp_discount, replace=True)
    OmegaConf.register_new_resolver("mirror_signs", _mirror_signs, replace=True)
    store = ConfigStore.instance()
    store.store(name="train_schema", node=TrainConfig)
    for group, schemas in (("algo", ALGOS), ("env", ENVS)):
        for name, schema in schemas.items():
            node = OmegaConf.structured(schema)
            for key in node:
                inner = node._get_node(key)
                if isinstance(inner, DictConfig):  # an argument of something: takes any keys
                    OmegaConf.set_struct(inner, False)
            store.store(group=group, name=f"{name}_schema", node=node)


def _pomdp_file(*, _parent_: DictConfig) -> str:
    """Absolute path of the file that ``path`` names; nothing if it names none, which is then said of ``path``."""
    return "" if OmegaConf.is_missing(_parent_, "path") else str(Path(_parent_.path).absolute())


def _pomdp_discount(*, _parent_: DictConfig) -> float:
    """The discount factor in that file."""
    try:
        return read_discount(_pomdp_file(_parent_=_parent_))
    except PomdpFileError:
        return 1.0  # for the environment to say what is wrong, in one line that names the file's


def _mirror_signs(observations: list[str], speed_profile: Any) -> list[float] | None:
    """Of a car's observations and actions."""
    from dpsearch.envs.driving.rules import mirror_signs

    return mirror_signs(observations, pedals=speed_profile is None)


def checked(config: DictConfig, choices: Mapping[str, str]) -> TrainConfig:
    """A configuration as objects.

    Args:
        config: The composed configuration, or a saved one.
        choices: The option chosen of each group.

    Raises:
        RunError: If a value is out of range, or an option has no schema.
        OmegaConfBaseException: If a value is missing or of the wrong type.
    """
    chosen = {}
    for group, schemas in (("algo", ALGOS), ("env", ENVS)):
        if choices[group] not in schemas:
            raise RunError(f"{group}={choices[group]} has no schema: there is one for {', '.join(schemas)}")
        chosen[group] = schemas[choices[group]]
    plain = OmegaConf.to_container(config)  # else a key that was forced in (+key=value) would be let through
    typed = OmegaConf.merge(OmegaConf.structured(TrainConfig), chosen, plain)
    assert isinstance(typed, DictConfig)
    for section in ("algo", "env", "policy", "rollout", None):  # one by one, to name the one that is wrong
        try:
            settings = OmegaConf.to_object(typed if section is None else typed[section])
        except OmegaConfBaseException:
            raise
        except ValueError as error:
            raise RunError(str(error) if section is None else f"{section}.{error}") from error
    assert isinstance(settings, TrainConfig)
    return settings
