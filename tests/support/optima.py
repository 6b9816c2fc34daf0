"""The finite POMDPs and what was computed for them elsewhere, by other programs, to the digits that were printed."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest

from dpsearch.envs.cheese_maze import CheeseMaze
from dpsearch.envs.maze4x3 import Maze4x3
from dpsearch.envs.maze89 import Maze89
from dpsearch.envs.shuttle import ShuttleDocking
from dpsearch.envs.tiger import Tiger
from dpsearch.envs.tmaze import TMaze
from dpsearch.pomdp.solvers.returns import Metrics
from dpsearch.pomdp.task import TabularTask

TASKS: dict[str, Callable[[], TabularTask]] = {
    "tiger": Tiger.make_task,
    "tiger, single": partial(Tiger.make_task, single=True),
    "shuttle": ShuttleDocking.make_task,
    "maze4x3": Maze4x3.make_task,
    "maze4x3, minus ends": partial(Maze4x3.make_task, minus_ends=True),
    "cheese": CheeseMaze.make_task,
    "cheese, anywhere": partial(CheeseMaze.make_task, start="anywhere", bump_reward=0.0),
    "tmaze 3": partial(TMaze.make_task, corridor_length=3),
    "tmaze 5": partial(TMaze.make_task, corridor_length=5),
    "tmaze 7": partial(TMaze.make_task, corridor_length=7),
    "tmaze 10": TMaze.make_task,
    "maze89": Maze89.make_task,
}

# Return, reward per step, thesis metric, discounted return, steps
RANDOM = {
    "tiger": "-3033.333 -30.33333 -30.33333 -121.33333 100",
    "tiger, single": "-45.50000 -30.33333 -36.68093 -40.44444 1.50000",
    "shuttle": "-169.433 -0.16943 -0.16943 -2.23040 1000",
    "maze4x3": "-1.96304 -0.06034 -0.00632 -1.96304 32.53076",
    "maze4x3, minus ends": "-1.09960 -0.05000 -0.09315 -1.09960 21.99209",
    "cheese": "-62.54944 -0.54318 -0.51973 -2.25099 115.15313",
    "cheese, anywhere": "0.99320 0.01038 0.06954 0.05933 95.70688",
    "tmaze 3": "0.05000 0.00156 0.05322 -0.10557 32.00000",
    "tmaze 5": "-2.15000 -0.02986 -0.00591 -1.19408 72.00000",
    "tmaze 7": "-5.14970 -0.04023 -0.02654 -1.88117 127.99152",
    "tmaze 10": "-11.08410 -0.04609 -0.03877 -2.41300 240.48076",
    "maze89": "0.21972 0.00100 0.00842 0.05565 220.47499",
}
OPTIMAL = {
    "tiger": "106.102 1.06102 1.06102 1.93344 100",
    "tiger, single": "3.99329 1.08379 1.26487 1.22401 3.68456",
    "shuttle": "1838.130 1.83813 1.83813 14.50371 1000",
    "cheese": "1.00000 0.16667 0.16667 0.16807 6.00000",
    "cheese, anywhere": "1.00000 0.22222 0.31524 0.36875 4.50000",
    "tmaze 3": "4.00000 1.00000 1.00000 3.76477 4",
    "tmaze 5": "4.00000 0.66667 0.66667 3.61568 6",
    "tmaze 7": "4.00000 0.50000 0.50000 3.47250 8",
    "tmaze 10": "4.00000 0.36364 0.36364 3.26829 11",
}
STATE_KNOWN = {"maze89": "1.00000 0.07894 0.11476 0.79605 12.66836"}
MEMORYLESS = {
    "tmaze 3": "1.95000 0.48750 0.48750 1.83532 4",
    "tmaze 5": "1.95000 0.32500 0.32500 1.76265 6",
    "tmaze 7": "1.95000 0.24375 0.24375 1.69284 8",
    "tmaze 10": "1.95000 0.17727 0.17727 1.59329 11",
}


def task(name: str) -> TabularTask:
    """One of ``TASKS``."""
    return TASKS[name]()


def values(metrics: Metrics) -> tuple[float, ...]:
    """The numbers in the order of the columns above."""
    columns = (
        metrics.episode_return,
        metrics.reward_per_step,
        metrics.thesis_metric,
        metrics.discounted_return,
        metrics.steps,
    )
    return tuple(estimate.value for estimate in columns)


def assert_as_printed(metrics: Metrics, row: str) -> None:
    """All numbers of a row, to the last digit of each."""
    for value, printed in zip(values(metrics), row.split(), strict=True):
        decimals = len(printed.partition(".")[2]) or 9  # a number without decimals is exact
        assert value == pytest.approx(float(printed), rel=0, abs=0.51 * 10**-decimals)
