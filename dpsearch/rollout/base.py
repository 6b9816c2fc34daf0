"""What every engine offers: two verbs, ``collect`` and ``evaluate``, and what a policy must fit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpsearch.policies.policy import RecurrentPolicy
from dpsearch.rollout.episodes import Episodes


class Rollouts(Protocol):
    """Plays episodes of one environment.

    Attributes:
        observation_space: The environment's own, of a single environment.
        action_space: The environment's own, of a single environment.
        observation_size: Length O of the flat observation a policy sees.
        max_steps: Step cap of an episode.
        reward_threshold: Mean return that counts as solved, or None if the environment names none.
        make_env: Makes one more environment of the kind; None if what there is came ready.
    """

    observation_space: gym.Space[Any]
    action_space: gym.Space[Any]
    observation_size: int
    max_steps: int
    reward_threshold: float | None
    make_env: Callable[[], gym.Env[Any, Any]] | None

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
            policy: Whose actions to take.
            n_episodes: Episodes B to play.
            key: 64-bit key of the randomness (``kernels.philox.stream_key``).
            first_episode: Number of the first episode: all randomness is a function of (key, number).
            greedy: Take the most probable action instead of a random one.
            record: False leaves observations, actions and rewards out, ``(0, B, ..)``: enough to evaluate.
        """
        ...

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
        """
        ...

    def close(self) -> None:
        """Let go of threads, processes and windows."""
        ...


def check_fit(policy: RecurrentPolicy, observation_size: int, action_size: int) -> None:
    """Make sure that a policy sees and does what an environment shows and takes.

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
