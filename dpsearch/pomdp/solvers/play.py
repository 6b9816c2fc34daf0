"""Plays agents in finite POMDPs: many episodes side by side, of which only sums are kept."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpsearch.env_kit.stepper import LaneStepper
from dpsearch.kernels.philox import stream_key
from dpsearch.pomdp.solvers.agents import Agent
from dpsearch.pomdp.solvers.returns import Metrics, metrics
from dpsearch.pomdp.task import TabularTask

ABREAST = 2_000
"""Episodes that are played side by side."""


@dataclass(frozen=True, eq=False)
class Played:
    """The outcomes of E episodes.

    Attributes:
        returns: Sum of each episode's rewards, ``(E,)``.
        discounted: Sum of each episode's rewards, discounted by the task's factor, ``(E,)``.
        lengths: Steps of each episode, ``(E,)``.
        terminated: Whether each episode ended by itself, not at the step limit, ``(E,)``.
    """

    returns: NDArray[np.float64]
    discounted: NDArray[np.float64]
    lengths: NDArray[np.int64]
    terminated: NDArray[np.bool_]

    def metrics(self) -> Metrics:
        """The metrics of these episodes."""
        return metrics(self.returns, self.discounted, self.lengths)


def play(task: TabularTask, agent: Agent, episodes: int, seed: int = 0) -> Played:
    """Plays an agent.

    Args:
        task: The task to play, up to its step limit.
        agent: The agent that plays.
        episodes: Number of episodes, at least 1.
        seed: Seed of all randomness. The task's own random numbers depend on the seed and the number of the episode
            alone, whichever agent plays.

    Raises:
        ValueError: If ``episodes`` is below 1 or the seed not in [0, 2**64).
    """
    if episodes < 1:
        raise ValueError(f"episodes must be at least 1, got {episodes}")
    parts = [_play(task, agent, np.arange(i, min(i + ABREAST, episodes)), seed) for i in range(0, episodes, ABREAST)]
    names = ("returns", "discounted", "lengths", "terminated")
    return Played(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _play(task: TabularTask, agent: Agent, episodes: NDArray[np.int64], seed: int) -> Played:
    n = len(episodes)
    uniforms = np.random.default_rng([seed, int(episodes[0])])  # for agents that draw their actions
    stepper = LaneStepper(task.kernel, n)
    for i, episode in enumerate(episodes):
        stepper.set_key(i, stream_key(seed, int(episode)))
    stepper.reset(np.ones(n, np.bool_))
    played = Played(np.zeros(n), np.zeros(n), np.zeros(n, np.int64), np.zeros(n, np.bool_))
    going_on = np.arange(n)
    actions = np.zeros(n, np.int64)
    memory = agent.start(_symbols(stepper))
    for t in range(task.max_episode_steps):
        chosen = agent.choose(memory, uniforms.random(len(going_on)))
        actions[going_on] = chosen
        rewards, terminated = stepper.step(actions)
        played.returns[going_on] += rewards[going_on]
        played.discounted[going_on] += task.pomdp.discount**t * rewards[going_on]
        played.lengths[going_on] = t + 1
        played.terminated[going_on] = terminated[going_on]
        stay = ~terminated[going_on]
        going_on = going_on[stay]
        if not len(going_on):
            break
        memory = agent.update(memory[stay], chosen[stay], _symbols(stepper)[going_on])
    return played


def _symbols(stepper: LaneStepper) -> NDArray[np.int64]:
    """The present symbol of each episode: row 1 of the kernel's state."""
    return stepper.state()[:, 1].astype(np.int64)
