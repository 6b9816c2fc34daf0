"""The performance of a policy over its episodes, in four metrics, for the literature does not agree on one.

Where episodes differ in length, three of them order policies differently: a policy may earn more in each episode by
taking longer, or more in each step by ending episodes early. The thesis reports the mean over episodes of the reward
per step (tables 6.1 and 7.2).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Estimate:
    """A number with its standard error.

    Attributes:
        value: The number.
        standard_error: Standard error of the number: 0 if it is exact, NaN if there is a single episode.
    """

    value: float
    standard_error: float = 0.0


@dataclass(frozen=True)
class Metrics:
    """The performance of a policy in a task. R is the sum of an episode's rewards, L the number of its steps.

    Attributes:
        episode_return: E[R], the mean return.
        reward_per_step: E[R] / E[L], the ratio of sums: rewards of all episodes together over steps of all together.
        thesis_metric: E[R / L], the mean of ratios, in which a short episode counts as much as a long one.
        discounted_return: E[r_1 + gamma r_2 + gamma^2 r_3 ...], from the start of an episode.
        steps: E[L], the mean length.
    """

    episode_return: Estimate
    reward_per_step: Estimate
    thesis_metric: Estimate
    discounted_return: Estimate
    steps: Estimate


def metrics(returns: ArrayLike, discounted: ArrayLike, lengths: ArrayLike) -> Metrics:
    """The metrics of E episodes. The standard error of the ratio of sums is by the delta method.

    Args:
        returns: Sum of rewards of each episode, ``(E,)``.
        discounted: Sum of discounted rewards of each episode, ``(E,)``; see :func:`discounted_sums`.
        lengths: Number of steps of each episode, ``(E,)``.

    Raises:
        ValueError: If the shapes differ, there is no episode, or an episode has no step.
    """
    earned, worth = np.asarray(returns, np.float64), np.asarray(discounted, np.float64)
    steps = np.asarray(lengths, np.float64)
    if not earned.shape == worth.shape == steps.shape or steps.ndim != 1:
        raise ValueError(f"shapes must be (E,) thrice, got {earned.shape}, {worth.shape} and {steps.shape}")
    if not len(steps) or steps.min() < 1:
        raise ValueError("there must be an episode, and each must have a step")
    ratio = earned.mean() / steps.mean()
    return Metrics(
        episode_return=_mean(earned),
        reward_per_step=Estimate(float(ratio), _standard_error((earned - ratio * steps) / steps.mean())),
        thesis_metric=_mean(earned / steps),
        discounted_return=_mean(worth),
        steps=_mean(steps),
    )


def discounted_sums(rewards: ArrayLike, gamma: float) -> NDArray[np.float64]:
    """The discounted sum of each column of rewards ``(T, B)`` that are zero beyond an episode's end: ``(B,)``."""
    paid = np.asarray(rewards, np.float64)
    sums: NDArray[np.float64] = gamma ** np.arange(len(paid)) @ paid
    return sums


def _mean(values: NDArray[np.float64]) -> Estimate:
    return Estimate(float(values.mean()), _standard_error(values))


def _standard_error(values: NDArray[np.float64]) -> float:
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else float("nan")
