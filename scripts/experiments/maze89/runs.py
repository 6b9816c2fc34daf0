"""One run in the 89-state maze, and how its policy is judged; or the judgement of an agent that has not learned."""

from __future__ import annotations

from collections.abc import Callable
from hashlib import sha256
from time import process_time

import numpy as np
from numpy.typing import NDArray

from dpsearch.envs.maze89 import Maze89
from dpsearch.pomdp.solvers.agents import Agent, BeliefAgent, Controller, fully_observed
from dpsearch.pomdp.solvers.play import play
from dpsearch.pomdp.solvers.point_based import point_based
from dpsearch.pomdp.solvers.value_iteration import value_iteration
from dpsearch.pomdp.task import TabularTask, tabular_task
from scripts.experiments.jobs import Outcome
from scripts.experiments.learning import CORE_SECONDS, ENV_STEPS, EPISODES, learn
from scripts.experiments.pomdps.hand_written import HAND_WRITTEN
from scripts.experiments.sampled_and_greedy import GREEDY, KINDS, SAMPLED
from scripts.experiments.training import compose

ROLLOUTS = 1_000  # that judge a policy
GOAL, MEDIAN, QUANTILE, ARRIVED = "goal", "median", "quantile_90", "median_arrived"


class Yardstick:
    """Settings of a cell whose agent does not learn.

    Args:
        name: Name of the agent, a key of ``AGENTS``.
    """

    network = ""

    def __init__(self, name: str) -> None:
        self._name = name

    def fingerprint(self) -> str:
        """Tells the agent from others."""
        return sha256(f"maze89 {self._name}".encode()).hexdigest()[:16]


def _random(task: TabularTask) -> Agent:
    return Controller.random(task.pomdp)


def _hand(task: TabularTask) -> Agent:
    return HAND_WRITTEN["maze89"](task.pomdp)


def _belief(task: TabularTask) -> BeliefAgent:
    return point_based(task.pomdp, rounds=10, beliefs=150, tolerance=1e-4).agent()


def _sighted(task: TabularTask) -> Agent:
    return value_iteration(task.pomdp).controller()


AGENTS: dict[str, tuple[str, Callable[[TabularTask], Agent]]] = {
    "random": ("random actions", _random),
    "hand": ("written by hand: goes where the most likely state would", _hand),
    "belief": ("best use of the belief, the model known (point-based)", _belief),
    "sighted": ("best for who sees the state", _sighted),
}
"""Label of each agent that does not learn, and the function that makes it."""


def measure(recipe: tuple[str, ...], seed: int) -> Outcome:
    """Learn by Hydra's overrides, or make the agent of that name, and judge the sampled and the greedy policy."""
    if recipe[0] in AGENTS:
        return _known(recipe[0], seed)
    run = learn(compose(recipe), seed)
    outcome: Outcome = {"solved": 1, **run.counts(CORE_SECONDS, ENV_STEPS, EPISODES)}
    for kind in KINDS:
        judged = run.algorithm.evaluate(ROLLOUTS, deterministic=kind == GREEDY)
        outcome |= _achieved(kind, judged.returns > 0.0, judged.lengths)
    return outcome


def _known(name: str, seed: int) -> Outcome:
    start, task = process_time(), Maze89.make_task()
    if name == "sighted":
        task = tabular_task(fully_observed(task.pomdp), task.max_episode_steps)
    played = play(task, AGENTS[name][1](task), 20 * ROLLOUTS, seed)
    found = _achieved(SAMPLED, played.terminated, played.lengths)
    return {"solved": 1, CORE_SECONDS: process_time() - start, **found, **{
        metric.replace(SAMPLED, GREEDY): value for metric, value in found.items()
    }}  # fmt: skip


def _achieved(kind: str, arrived: NDArray[np.bool_], lengths: NDArray[np.int64]) -> dict[str, float]:
    """Metrics of E episodes, ``(E,)`` each; one that fails counts as longer than all others."""
    steps = np.where(arrived, lengths, lengths.max() + 1)
    return {
        f"{kind}_{GOAL}": 100.0 * float(arrived.mean()),
        f"{kind}_{MEDIAN}": float(np.median(steps)),
        f"{kind}_{QUANTILE}": float(np.quantile(steps, 0.9)),
        f"{kind}_{ARRIVED}": float(np.median(lengths[arrived])) if arrived.any() else float(lengths.max() + 1),
    }
