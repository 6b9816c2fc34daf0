"""Rollouts: two verbs, ``collect`` and ``evaluate``, written once for both engines.

An engine says how queued episodes are played, in ``play``; ``lane_engine.py`` and ``gym_engine.py`` do. To play
episodes elsewhere, on a cluster for example, implement ``play`` and ``close``; for populations alone, override
``evaluate``. Give the object to an algorithm as its environment.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpsearch.policies.policy import RecurrentPolicy
from dpsearch.rollout.episodes import Episodes


class EnvironmentFailedError(RuntimeError):
    """An environment raised, or showed what is not a finite number of the right shape."""


class Rollouts(ABC):
    """Plays episodes of one environment.

    Attributes:
        observation_space: The observation space of a single environment.
        action_space: The action space of a single environment.
        observation_size: Length O of the flat observation a policy sees.
        max_steps: Step cap of an episode.
        reward_threshold: Mean return that counts as solved, or None if the environment names none.
        make_env: Makes one more environment of the kind; None for an environment that came ready made.
        mirror_signs: The signs by which a mirror multiplies each number of a flat observation, then of an action; None
            if the environment declares none. See ``dpsearch/env_kit/symmetry.py``.
    """

    observation_space: gym.Space[Any]
    action_space: gym.Space[Any]
    observation_size: int
    max_steps: int
    reward_threshold: float | None
    make_env: Callable[[], gym.Env[Any, Any]] | None
    mirror_signs: Sequence[float] | None = None

    def collect(
        self,
        policy: RecurrentPolicy,
        n_episodes: int,
        *,
        key: int,
        first_episode: int = 0,
        greedy: bool = False,
        record: bool = True,
    ) -> Episodes:
        """Play whole episodes with one policy.

        Args:
            policy: The policy that acts.
            n_episodes: Episodes B to play.
            key: 64-bit key of the randomness (``kernels.philox.stream_key``).
            first_episode: Number of the first episode: all randomness is a function of (key, number).
            greedy: Take the most probable action instead of a random one.
            record: False leaves observations, actions and rewards out, ``(0, B, ..)``: enough to evaluate.

        Raises:
            ValueError: If the policy does not fit the environment, or ``n_episodes`` is below 1.
            EnvironmentFailedError: If the environment raises, or shows what is not a finite number of the right shape.
        """
        if n_episodes < 1:
            raise ValueError(f"n_episodes must be at least 1, got {n_episodes}")
        numbers = np.arange(first_episode, first_episode + n_episodes, dtype=np.uint64)
        candidates = np.zeros(n_episodes, np.int64)
        return self.play(policy, policy.vector(), key, numbers, candidates, greedy, record=record)

    def evaluate(
        self,
        policy: RecurrentPolicy,
        population: ArrayLike,
        *,
        key: int,
        episodes: ArrayLike,
        greedy: bool = False,
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Play episodes with many weight vectors.

        Args:
            policy: The architecture; its own weights are not used.
            population: ``(N, P)`` weight vectors in the layout of ``policy.vector()``.
            key: 64-bit key of the randomness.
            episodes: ``(N, E)`` episode numbers that each candidate plays. Rows that are equal give all
                candidates the same start states and noise (common random numbers).
            greedy: Take the most probable action instead of a random one.

        Returns:
            Undiscounted returns ``(N, E)`` and lengths ``(N, E)`` in steps.

        Raises:
            ValueError: If the policy does not fit the environment, or the arrays do not fit the policy.
            EnvironmentFailedError: If the environment raises, or shows what is not a finite number of the right shape.
        """
        weights, numbers = check_population(policy, population, episodes)
        candidates = np.repeat(np.arange(len(weights)), numbers.shape[1])
        played = self.play(policy, weights, key, numbers.ravel(), candidates, greedy, record=False)
        return played.returns.reshape(numbers.shape), played.lengths.reshape(numbers.shape)

    @abstractmethod
    def play(
        self,
        policy: RecurrentPolicy,
        weights: NDArray[np.float64],
        key: int,
        numbers: NDArray[np.uint64],
        candidates: NDArray[np.int64],
        greedy: bool,
        *,
        record: bool,
    ) -> Episodes:
        """Play the queued episodes.

        Args:
            policy: The architecture.
            weights: ``(P,)`` for all episodes, or ``(N, P)``, a row for each candidate.
            key: 64-bit key of the randomness.
            numbers: ``(B,)`` episode numbers.
            candidates: ``(B,)``, the row of ``weights`` that plays each episode.
            greedy: Take the most probable action instead of a random one.
            record: Whether observations, actions and rewards are kept.
        """

    @abstractmethod
    def close(self) -> None:
        """Let go of threads, processes and windows."""


def check_fit(policy: RecurrentPolicy, observation_size: int, action_size: int) -> None:
    """Check that a policy has the sizes of the environment's observations and actions.

    Raises:
        ValueError: If it does not.
    """
    if (policy.observation_size, policy.head.action_size) != (observation_size, action_size):
        raise ValueError(
            f"the policy maps {policy.observation_size} observations to {policy.head.action_size} actions, "
            f"the environment has {observation_size} and {action_size}"
        )


def check_population(
    policy: RecurrentPolicy, population: ArrayLike, episodes: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.uint64]]:
    """The arguments of ``Rollouts.evaluate`` as contiguous arrays: weights ``(N, P)`` and numbers ``(N, E)``.

    Raises:
        ValueError: If they do not fit one another or the policy, or there is nothing to play.
    """
    weights = np.ascontiguousarray(population, np.float64)
    numbers = np.ascontiguousarray(episodes, np.uint64)
    if weights.ndim != 2 or numbers.ndim != 2 or len(weights) != len(numbers) or numbers.size == 0:
        shapes = f"{weights.shape} and {numbers.shape}"
        raise ValueError(f"population (N, P) and episodes (N, E) do not fit: {shapes}")
    size = sum(parameter.numel() for parameter in policy.free_parameters())
    if weights.shape[1] != size:
        raise ValueError(f"this policy has {size} free parameters, got weight vectors of {weights.shape[1]}")
    return weights, numbers
