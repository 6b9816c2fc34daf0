"""The base class of all algorithms: rollouts, a policy and counters; learn, predict, evaluate, save and load."""

from __future__ import annotations

import dataclasses
import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from os import PathLike
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from dpsearch.files import CheckpointError, read_checkpoint, write_checkpoint
from dpsearch.kernels.philox import stream_key
from dpsearch.policies import PolicyConfig, RecurrentPolicy
from dpsearch.policies.observations import flattener
from dpsearch.policies.spaces import to_env_actions
from dpsearch.renamed import renaming
from dpsearch.rollout import EnvSource, Episodes, Rollouts, make_rollouts

TRAINING, EVALUATION, WEIGHTS, SOLVING, BASELINE = 1, 2, 3, 4, 6  # purposes of a seed's streams
RECENT_EPISODES = 100  # training episodes whose mean return is reported, and evaluation episodes that decide "solved"

Env = EnvSource | Rollouts
Metrics = dict[str, float]
ConfigT = TypeVar("ConfigT")


@dataclass(frozen=True)
class Evaluation:
    """Returns and lengths of E evaluation episodes.

    Attributes:
        returns: Undiscounted return of each episode, ``(E,)``.
        lengths: Steps of each episode, ``(E,)``.
    """

    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]

    @property
    def mean_return(self) -> float:
        """Mean undiscounted return."""
        return float(self.returns.mean())

    @property
    def standard_error(self) -> float:
        """Standard error of the mean return; NaN for a single episode."""
        return float(self.returns.std(ddof=1) / np.sqrt(len(self.returns))) if len(self.returns) > 1 else float("nan")

    @property
    def mean_length(self) -> float:
        """Mean number of steps."""
        return float(self.lengths.mean())


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Make torch use one thread: fastest for small networks, and sums then do not depend on the number of threads."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


class Algorithm(ABC, Generic[ConfigT]):
    """Learns a policy for an environment.

    A run is a function of (env, config, policy, seed): randomness is keyed by the episode's number, so the same run
    comes out bit for bit with any number of threads, and when it goes on from a checkpoint.

    Args:
        env: A Gymnasium id, environment, vector environment, factory, or ready ``Rollouts``.
        config: The algorithm's settings; its defaults if None.
        policy: The policy to train, or the architecture of a new one.
        seed: Seed of everything random, in [0, 2**64).
        threads: Threads of the lane engine; results do not depend on it.
        env_kwargs: Arguments of the environment, when ``env`` is an id or a factory.
        max_episode_steps: Step limit of an episode, in place of the environment's own.
        **overrides: Single settings of ``config``, by name.

    Attributes:
        parts: Names of attributes whose ``state_dict`` a checkpoint holds; one that is None has none.
        values: Names of attributes that a checkpoint holds as they are.

    Raises:
        ValueError: If a setting is out of range, or the environment is unknown or refuses its arguments.
        TypeError: If there is no such setting.
        UnsupportedSpaceError: If no policy can handle the environment's spaces.
    """

    name: ClassVar[str]
    config_type: ClassVar[type[Any]]
    parts: ClassVar[tuple[str, ...]] = ("policy",)
    values: ClassVar[tuple[str, ...]] = ("updates", "episodes", "env_steps", "solved")
    deterministic_policy: ClassVar[bool] = False
    default_policy: ClassVar[PolicyConfig] = PolicyConfig()

    def __init__(
        self,
        env: Env,
        config: ConfigT | None = None,
        *,
        policy: PolicyConfig | RecurrentPolicy | None = None,
        seed: int = 0,
        threads: int = 1,
        env_kwargs: dict[str, Any] | None = None,
        max_episode_steps: int | None = None,
        **overrides: Any,
    ) -> None:
        for name in overrides:
            if words := renaming(f"algo.{name}"):
                raise TypeError(words)
        settings: Any = self.config_type() if config is None else config
        self.config: ConfigT = dataclasses.replace(settings, **overrides)
        self.seed = seed
        self.training_key = stream_key(seed, TRAINING)
        self.evaluation_key = stream_key(seed, EVALUATION)
        self.solving_key = stream_key(seed, SOLVING)
        self.env_id = env if isinstance(env, str) else None
        self.env_kwargs = env_kwargs or {}
        self.max_episode_steps = max_episode_steps
        self.rollouts: Rollouts = (
            env
            if isinstance(env, Rollouts)
            else make_rollouts(env, threads=threads, env_kwargs=env_kwargs, max_episode_steps=max_episode_steps)
        )
        if isinstance(policy, RecurrentPolicy):
            self.policy = policy
        else:
            self.policy = RecurrentPolicy.for_spaces(
                self.rollouts.observation_space,
                self.rollouts.action_space,
                policy or self.default_policy,
                deterministic=self.deterministic_policy,
                seed=stream_key(seed, WEIGHTS) >> 1,  # torch takes 63 bits
            )
        self.updates = 0
        self.episodes = 0
        self.env_steps = 0
        self.solved = False
        self.recent_returns: deque[float] = deque(maxlen=RECENT_EPISODES)
        self._flatten = flattener(self.rollouts.observation_space)
        self._predictions = np.random.default_rng(seed)

    @property
    def finished(self) -> bool:
        """Whether there is nothing more to learn, whatever the limits."""
        return False

    @property
    def evaluations(self) -> int:
        """Evaluations of a policy: an algorithm that learns from episodes judges it by each of them."""
        return self.episodes

    @property
    def nothing_is_random(self) -> bool:
        """Whether all episodes of one policy are surely alike: neither environment nor policy draws a number."""
        kernel = getattr(self.rollouts, "kernel", None)
        return kernel is not None and kernel.draws == 0 and self.policy.head.draws == 0

    @property
    def headline(self) -> str:
        """Present performance in two or three words."""
        return f"return {np.mean(self.recent_returns):,.6g}" if self.recent_returns else "no episode over yet"

    @abstractmethod
    def update(self) -> Metrics:
        """One iteration: play, learn, count. Returns scalars to log."""

    def learn(
        self,
        *,
        total_steps: int | None = None,
        total_episodes: int | None = None,
        total_updates: int | None = None,
        until_solved: bool = False,
        callback: Callable[[Self, Metrics], object] | None = None,
    ) -> Self:
        """Update until a limit is reached, counted from the very beginning of the run.

        Args:
            total_steps: Environment steps.
            total_episodes: Episodes.
            total_updates: Updates.
            until_solved: Stop when ``check_solved`` says so.
            callback: Called after each update with the algorithm and its metrics. It stops the training by returning
                something false other than None: False, NumPy's False or 0.

        Raises:
            ValueError: If nothing would ever stop it.
        """
        if until_solved and self.rollouts.reward_threshold is None:
            raise ValueError("until_solved needs an environment with a reward_threshold; this one has none")
        limits = (total_steps, total_episodes, total_updates)
        if all(limit is None for limit in limits) and not until_solved and callback is None:
            raise ValueError("learn() needs total_steps, total_episodes, total_updates, until_solved or a callback")
        with one_torch_thread():
            while not self.finished and not (until_solved and self.solved):
                counts = (self.env_steps, self.episodes, self.updates)
                if any(limit is not None and count >= limit for count, limit in zip(counts, limits, strict=True)):
                    break
                metrics = self.update()
                if until_solved:
                    self.solved = self.check_solved()
                if callback is not None and (answer := callback(self, metrics)) is not None and not answer:
                    break
        return self

    def play_batch(self, n_episodes: int) -> Episodes:
        """The next training episodes of this run, counted.

        Raises:
            FloatingPointError: If the environment paid a reward that is not finite.
        """
        episodes = self.rollouts.collect(self.policy, n_episodes, key=self.training_key, first_episode=self.episodes)
        returns = episodes.returns.tolist()
        if not math.isfinite(sum(returns)) and not np.isfinite(episodes.returns).all():
            worst = self.episodes + int(np.argmin(np.isfinite(episodes.returns)))
            raise FloatingPointError(f"the environment paid a reward that is NaN or infinite in episode {worst}")
        self.count(returns, episodes.steps)
        return episodes

    def count(self, returns: list[float], steps: int) -> None:
        """Count environment steps of training, and the episodes that ended in them, with undiscounted ``returns``."""
        self.episodes += len(returns)
        self.env_steps += steps
        self.recent_returns.extend(returns)

    def check_solved(self) -> bool:
        """Whether 100 evaluation episodes of the stochastic policy reach the environment's reward threshold.

        They are played only when the last 100 training episodes did: evaluating an unskilled policy is slow.
        """
        threshold = self.rollouts.reward_threshold
        if threshold is None or len(self.recent_returns) < RECENT_EPISODES:
            return False
        return bool(np.mean(self.recent_returns) >= threshold) and self.solving_return() >= threshold

    def solving_return(self, n_episodes: int = RECENT_EPISODES) -> float:
        """Mean return of the episodes that decide, at this update, whether the task is solved."""
        played = self.rollouts.collect(
            self.policy,
            n_episodes,
            key=self.solving_key,  # of its own: what stopped the training must not also be what reports its success
            first_episode=self.updates * RECENT_EPISODES,
            record=False,
        )
        return float(played.returns.mean())

    def evaluate(self, n_episodes: int = 100, *, deterministic: bool = False) -> Evaluation:
        """Play episodes without learning from them; other ones after each update.

        Args:
            n_episodes: How many, at most 2**24.
            deterministic: Greedy actions instead of sampled ones.

        Raises:
            FloatingPointError: If the environment paid a reward that is not finite.
        """
        episodes = self.rollouts.collect(
            self.policy,
            1 if self.nothing_is_random else n_episodes,  # all would be alike
            key=self.evaluation_key,
            first_episode=self.updates << 24,
            greedy=deterministic,
            record=False,
        )
        if not np.isfinite(episodes.returns).all():
            raise FloatingPointError("the environment paid a reward that is NaN or infinite in an evaluation episode")
        alike = n_episodes // len(episodes)
        return Evaluation(np.tile(episodes.returns, alike), np.tile(episodes.lengths, alike))

    def predict(
        self,
        observation: Any,
        state: NDArray[np.float32] | None = None,
        episode_start: NDArray[np.bool_] | bool | None = None,
        deterministic: bool = False,
    ) -> tuple[Any, NDArray[np.float32]]:
        """The policy's action for one environment, or for several at once.

        Args:
            observation: An element of the environment's observation space, or a batch of B of them; ``array([2])`` of a
                Discrete space is a batch of one.
            state: What the last call returned; None at the start.
            episode_start: ``(B,)``, True where a new episode begins: that memory is wiped first.
            deterministic: The greedy action instead of a sampled one.

        Returns:
            The action, or ``(B, ..)`` actions, in the environment's own units; and the memory to pass next time.

        Raises:
            ValueError: If the observation does not have the shape that the space says, or is not finite.
        """
        single = self._flatten.is_one(observation)
        flat = self._flatten.one(observation)[None] if single else self._flatten.batch(observation)
        if not np.isfinite(flat).all():
            raise ValueError("observation must be finite, got NaN or infinity")
        memory = np.zeros((len(flat), self.policy.state_size), np.float32) if state is None else state.copy()
        if episode_start is not None:
            memory[np.broadcast_to(episode_start, len(flat))] = 0.0
        uniforms = None if deterministic else 1.0 - self._predictions.random((len(flat), self.policy.head.draws))
        actions, after = self.policy.act(
            torch.from_numpy(flat),
            torch.from_numpy(memory),
            None if uniforms is None else torch.from_numpy(uniforms),
        )
        env_actions = to_env_actions(self.rollouts.action_space, actions.numpy())
        return (env_actions[0] if single else env_actions), after.numpy()

    def close(self) -> None:
        """Let go of threads, processes and windows."""
        self.rollouts.close()

    def state_dict(self) -> dict[str, Any]:
        """Everything that the rest of the run depends on, as tensors and plain values."""
        parts = {name: part.state_dict() for name in self.parts if (part := getattr(self, name)) is not None}
        values = {name: getattr(self, name) for name in self.values}
        return {**parts, **values, "recent_returns": list(self.recent_returns)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue exactly from where ``state_dict`` was taken."""
        for name in self.parts:
            part = getattr(self, name)
            if part is not None:
                part.load_state_dict(state[name])
        for name in self.values:
            setattr(self, name, state[name])
        self.recent_returns = deque(state["recent_returns"], maxlen=RECENT_EPISODES)

    def save(self, path: str | PathLike[str]) -> None:
        """Write everything to one file, from which ``load`` goes on bit for bit."""
        write_checkpoint(
            path,
            {
                "algo": self.name,
                "config": dataclasses.asdict(self.config),  # type: ignore[call-overload]  # each is a dataclass
                "policy": self.policy.config(),
                "env": self.env_id,
                "env_kwargs": self.env_kwargs,
                "max_episode_steps": self.max_episode_steps,
                "seed": self.seed,
                "state": self.state_dict(),
            },
        )

    @classmethod
    def load(
        cls,
        path: str | PathLike[str],
        env: Env | None = None,
        *,
        env_kwargs: dict[str, Any] | None = None,
        threads: int = 1,
    ) -> Self:
        """The algorithm as ``save`` left it.

        Args:
            path: The file.
            env: The environment; may be left out if it was given by its id.
            env_kwargs: Arguments of the environment; those saved if None and ``env`` is an id, a factory or left out.
            threads: Threads of the lane engine.

        Raises:
            CheckpointError: If the file is truncated, corrupt, of another algorithm, or does not fit ``env``.
        """
        content = read_checkpoint(path)
        if content.get("algo") != cls.name:
            raise CheckpointError(f"{path} was saved by {content.get('algo')!r}, not by algorithm {cls.name!r}")
        if env is None and content["env"] is None:
            raise CheckpointError(f"{path} does not know its environment's id: give load(path, env=...)")
        source: Env = content["env"] if env is None else env
        to_make = isinstance(source, str) or (callable(source) and not isinstance(source, Rollouts))
        algorithm = cls(
            source,
            cls.config_type(**content["config"]),
            policy=PolicyConfig(**content["policy"]),
            seed=content["seed"],
            threads=threads,
            env_kwargs=content["env_kwargs"] if env_kwargs is None and to_make else env_kwargs,
            max_episode_steps=content["max_episode_steps"] if to_make else None,
        )
        try:
            algorithm.load_state_dict(content["state"])
        except (KeyError, RuntimeError, ValueError) as error:
            raise CheckpointError(f"{path} does not fit this environment: {str(error).splitlines()[0]}") from error
        return algorithm
