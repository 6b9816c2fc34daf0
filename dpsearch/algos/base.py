"""The base class of all algorithms: rollouts, a policy and counters; learn, predict, evaluate, save and load."""

from __future__ import annotations

import dataclasses
import math
import warnings
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from functools import partial
from os import PathLike
from typing import Any, ClassVar, Generic, Self, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from dpsearch.algos.evaluation import Evaluation
from dpsearch.algos.memory import check_batches, check_weights, memory_errors
from dpsearch.algos.stored import StoredAlgorithm
from dpsearch.algos.threads import one_torch_thread
from dpsearch.files import plain, write_checkpoint
from dpsearch.kernels.philox import stream_key
from dpsearch.policies import PolicyConfig, RecurrentPolicy
from dpsearch.policies.observations import flattener
from dpsearch.policies.spaces import to_env_actions
from dpsearch.renamed import renaming
from dpsearch.rollout import EnvRecipe, EnvSource, Episodes, Rollouts, make_rollouts

TRAINING, EVALUATION, WEIGHTS, SOLVING, BASELINE = 1, 2, 3, 4, 6  # purposes of a seed's streams
RECENT_EPISODES = 100  # training episodes whose mean return is reported, and evaluation episodes that decide "solved"

Env = EnvSource | Rollouts
Metrics = dict[str, float]
ConfigT = TypeVar("ConfigT")


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
        recipe: How ready ``Rollouts`` were made, so that ``load`` can make them again.
        **overrides: Single settings of ``config``, by name.

    Attributes:
        parts: Names of attributes whose ``state_dict`` a checkpoint holds; one that is None has none.
        values: Names of attributes that a checkpoint holds as they are.

    Raises:
        ValueError: If a setting is out of range, too large for the memory, or not such that a checkpoint can hold it
            (numbers, NumPy's too, strings, lists and dicts), or the environment is unknown or refuses its arguments.
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
        recipe: EnvRecipe | None = None,
        **overrides: Any,
    ) -> None:
        for name in overrides:
            if words := renaming(f"algo.{name}"):
                raise TypeError(words)
        settings: Any = self.config_type() if config is None else config
        overrides = {name: plain(value, name) for name, value in overrides.items()}
        self.config: ConfigT = plain(dataclasses.replace(settings, **overrides), "config")
        self.seed = seed = plain(seed, "seed")
        env_kwargs = None if env_kwargs is None else plain(env_kwargs, "env_kwargs")
        max_episode_steps = plain(max_episode_steps, "max_episode_steps")
        self.training_key = stream_key(seed, TRAINING)
        self.evaluation_key = stream_key(seed, EVALUATION)
        self.solving_key = stream_key(seed, SOLVING)
        self.env_id = env if isinstance(env, str) else None
        self.env_kwargs = env_kwargs or {}
        self.max_episode_steps = max_episode_steps
        self.recipe = recipe
        self.rollouts: Rollouts = (
            env
            if isinstance(env, Rollouts)
            else make_rollouts(env, threads=threads, env_kwargs=env_kwargs, max_episode_steps=max_episode_steps)
        )
        if isinstance(policy, RecurrentPolicy):
            self.policy = policy
        else:
            make_policy = partial(
                RecurrentPolicy.for_spaces,
                self.rollouts.observation_space,
                self.rollouts.action_space,
                plain(policy or self.default_policy, "policy"),
                deterministic=self.deterministic_policy,
                seed=stream_key(seed, WEIGHTS) >> 1,  # torch takes 63 bits
            )
            check_weights(make_policy)
            self.policy = make_policy()
        check_batches(self.config, self.policy)
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

        A call that has nothing to do warns, and says why.

        Raises:
            ValueError: If nothing would ever stop it.
        """
        if until_solved and self.rollouts.reward_threshold is None:
            raise ValueError("until_solved needs an environment with a reward_threshold; this one has none")
        limits = (total_steps, total_episodes, total_updates)
        if all(limit is None for limit in limits) and not until_solved and callback is None:
            raise ValueError("learn() needs total_steps, total_episodes, total_updates, until_solved or a callback")
        if reason := self.reason_to_stop(*limits, until_solved):
            warnings.warn(f"learn() has nothing to do: {reason}", stacklevel=2)
        with one_torch_thread(), memory_errors():
            while not self.reason_to_stop(*limits, until_solved):
                metrics = self.update()
                if until_solved:
                    self.solved = self.check_solved()
                if callback is not None and (answer := callback(self, metrics)) is not None and not answer:
                    break
        return self

    def reason_to_stop(
        self,
        total_steps: int | None = None,
        total_episodes: int | None = None,
        total_updates: int | None = None,
        until_solved: bool = False,
    ) -> str:
        """The reason why ``learn`` with these limits would make no further update; empty if it would."""
        if self.finished:
            return "the algorithm has finished, whatever the limits"
        if until_solved and self.solved:
            return "the task is solved, and until_solved is True"
        limits = {"total_steps": total_steps, "total_episodes": total_episodes, "total_updates": total_updates}
        counts = (self.env_steps, self.episodes, self.updates)
        for (name, limit), count in zip(limits.items(), counts, strict=True):
            if limit is not None and count >= limit:
                return f"{name}={limit} is counted from the beginning of the run, which has come to {count}"
        return ""

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

    def solves(self) -> bool:
        """Whether the episodes that decide reach the environment's reward threshold."""
        threshold = self.rollouts.reward_threshold
        return threshold is not None and self.solving_return() >= threshold

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
        evaluation = self.play_evaluation(n_episodes, deterministic=deterministic)
        if not np.isfinite(evaluation.returns).all():
            raise FloatingPointError("the environment paid a reward that is NaN or infinite in an evaluation episode")
        return evaluation

    def play_evaluation(self, n_episodes: int, *, first: int = 0, deterministic: bool = False) -> Evaluation:
        """Play some of the episodes that ``evaluate`` plays, whatever they pay.

        Args:
            n_episodes: How many.
            first: Number of the first among them.
            deterministic: Greedy actions instead of sampled ones.
        """
        episodes = self.rollouts.collect(
            self.policy,
            1 if self.nothing_is_random else n_episodes,  # all would be alike
            key=self.evaluation_key,
            first_episode=(self.updates << 24) + first,
            greedy=deterministic,
            record=False,
        )
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
            if (part := getattr(self, name)) is not None:
                part.load_state_dict(state[name])
        for name in self.values:
            setattr(self, name, state[name])
        self.recent_returns = deque(state["recent_returns"], maxlen=RECENT_EPISODES)

    def content(self) -> dict[str, Any]:
        """Everything that ``save`` writes."""
        return {
            "algo": self.name,
            "config": dataclasses.asdict(self.config),  # type: ignore[call-overload]  # each is a dataclass
            "policy": plain(self.policy.config(), "policy"),
            "env": self.env_id,
            "env_kwargs": self.env_kwargs,
            "max_episode_steps": self.max_episode_steps,
            "recipe": None if self.recipe is None else dataclasses.asdict(self.recipe),
            "seed": self.seed,
            "state": self.state_dict(),
        }

    def save(self, path: str | PathLike[str]) -> None:
        """Write everything to one file, from which ``load`` goes on bit for bit; a missing folder is made."""
        write_checkpoint(path, self.content())

    @classmethod
    def load(
        cls,
        path: str | PathLike[str],
        env: Env | None = None,
        *,
        env_kwargs: dict[str, Any] | None = None,
        threads: int = 1,
        recipe: EnvRecipe | None = None,
    ) -> Self:
        """The algorithm as ``save``, or a run, left it.

        Warns if other versions of torch, NumPy and the like are at work here: the numbers may then go on differently.

        Args:
            path: The file, or the directory of a run.
            env: The environment; may be left out for a run, and for one that was given by its id, unless a module that
                is not dpsearch's would have to be imported for it.
            env_kwargs: Arguments of the environment; those saved if None and ``env`` is an id, a factory or left out.
            threads: Threads of the lane engine.
            recipe: How ready ``Rollouts`` were made.

        Raises:
            CheckpointError: If the file is damaged, of another algorithm, or does not fit ``env``.
            RunError: If the environment of the run cannot be made.
        """
        stored = StoredAlgorithm.read(path, cls.name)
        chosen = stored.environment(env, env_kwargs, threads, recipe)
        algorithm = stored.rebuild(cls, chosen)
        if algorithm.solved and not stored.is_of(chosen):
            algorithm.solved = algorithm.solves()
        return algorithm
