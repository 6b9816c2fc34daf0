"""The small POMDPs of tables 6.1 and 7.2, as the thesis's text and as its numbers have them, and their yardsticks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache, partial

from dpsearch.envs.cheese_maze import CheeseMaze
from dpsearch.envs.maze4x3 import Maze4x3
from dpsearch.envs.shuttle import ShuttleDocking
from dpsearch.envs.tiger import Tiger
from dpsearch.envs.tmaze import TMaze
from dpsearch.pomdp.solvers.agents import Agent, BeliefAgent, Controller, fully_observed
from dpsearch.pomdp.solvers.exact import controller_of, exact_metrics
from dpsearch.pomdp.solvers.play import play
from dpsearch.pomdp.solvers.point_based import point_based
from dpsearch.pomdp.solvers.returns import Metrics
from dpsearch.pomdp.solvers.value_iteration import value_iteration
from dpsearch.pomdp.task import TabularTask, tabular_task
from scripts.experiments.pomdps.hand_written import HAND_WRITTEN

EPISODES = 20_000  # of policies whose metrics are not computed exactly
GOAL = 0.98
ROLLOUTS, MORE_ROLLOUTS = 1_000, 10_000  # that judge a learned policy
UNDISCOUNTED = 0.9999  # instead of 1, for which the solver has no solution


@dataclass(frozen=True)
class PomdpTask:
    """A task of the tables.

    Attributes:
        name: Short name, for the command line and the log of runs.
        label: Name in tables.
        env: Name of the environment's config, and of the hand-written policy.
        overrides: Hydra's overrides that choose the variant.
        task: Function that makes the task.
        batch: Episodes that LRWR plays in an EM step (section 6.3.6).
        goal: Part of the way from random to optimal that counts as reached.
        rollouts: Episodes that judge a policy: more of them where a single one tells little.
    """

    name: str
    label: str
    env: str
    overrides: tuple[str, ...]
    task: Callable[[], TabularTask] = field(compare=False)
    batch: int = 30
    goal: float = GOAL
    rollouts: int = ROLLOUTS

    @property
    def episodes(self) -> int:
        """Episodes of a run: those of 100 EM steps."""
        return 100 * self.batch


def _corridor(length: int, *, either: bool = False) -> PomdpTask:
    reward = (f"env.wrong_turn_reward={4.0 if either else -0.1}",)
    return PomdpTask(
        name=f"tmaze{length}" + ("_either" if either else ""),
        label=f"T-maze {length}" + (", either turn" if either else ""),
        env="tmaze",
        overrides=(f"env.corridor_length={length}", *(reward if either else ())),
        task=partial(TMaze.make_task, corridor_length=length, wrong_turn_reward=4.0 if either else -0.1),
        batch=75,
    )


TIGER = PomdpTask("tiger", "Tiger", "tiger", (), Tiger.make_task)
SHUTTLE = PomdpTask("shuttle", "Shuttle docking", "shuttle", (), ShuttleDocking.make_task, goal=0.95)
MAZE4X3 = PomdpTask("maze4x3", "4x3 maze", "maze4x3", (), Maze4x3.make_task, rollouts=MORE_ROLLOUTS)
CHEESE = PomdpTask("cheese", "Cheese maze", "cheese", (), CheeseMaze.make_task, batch=75)
TEXT = (TIGER, SHUTTLE, MAZE4X3, CHEESE, _corridor(3), _corridor(5), _corridor(7))
"""The tasks as the thesis describes them."""

SINGLE = PomdpTask(
    "tiger_single",
    "Tiger, one door",
    "tiger",
    ("env.single=true",),
    partial(Tiger.make_task, single=True),
)
ANYWHERE = PomdpTask(
    "cheese_anywhere",
    "Cheese, from anywhere",
    "cheese",
    ("env.start=anywhere", "env.bump_reward=0.0"),
    partial(CheeseMaze.make_task, start="anywhere", bump_reward=0.0),
    batch=75,
)
SLIPPERY = PomdpTask(
    "maze4x3_any_way",
    "4x3 maze, slips any way",
    "maze4x3",
    ("env.slips=any_way", "env.minus_reward=-0.04"),
    partial(Maze4x3.make_task, slips="any_way", minus_reward=-0.04),
    rollouts=MORE_ROLLOUTS,
)
BEHIND = (SINGLE, SLIPPERY, ANYWHERE, _corridor(3, either=True), _corridor(5, either=True), _corridor(7, either=True))
"""The tasks that the thesis's numbers belong to, where its text describes another."""

TASKS = {task.name: task for task in (*TEXT, *BEHIND)}


@dataclass(frozen=True)
class Yardsticks:
    """Metrics of policies that are not learned.

    Attributes:
        random: Metrics of taking all actions equally often.
        hand: Metrics of the policy written by hand.
        optimal: Metrics of the best policy for the discounted return.
        sighted: Metrics of the best policy of an agent that sees the state.
    """

    random: Metrics
    hand: Metrics
    optimal: Metrics
    sighted: Metrics

    def share(self, discounted: float) -> float:
        """The part of the way from the random to the optimal policy that a discounted return has gone."""
        low, high = self.random.discounted_return.value, self.optimal.discounted_return.value
        return (discounted - low) / (high - low)


@cache
def yardsticks(name: str) -> Yardsticks:
    """The yardsticks of a task, computed from its tables."""
    task = TASKS[name].task()
    pomdp = task.pomdp
    best = point_based(pomdp, min(pomdp.discount, UNDISCOUNTED)).agent()
    seen = tabular_task(fully_observed(pomdp), task.max_episode_steps)
    return Yardsticks(
        random=exact_metrics(task, Controller.random(pomdp)),
        hand=_metrics(task, HAND_WRITTEN[TASKS[name].env](pomdp)),
        optimal=_metrics(task, best),
        sighted=exact_metrics(seen, value_iteration(pomdp).controller()),
    )


def _metrics(task: TabularTask, agent: Agent) -> Metrics:
    """Exact, if the agent comes to few different beliefs, else of many episodes."""
    if isinstance(agent, BeliefAgent):
        try:
            agent = controller_of(agent, most=2_000)
        except ValueError:
            return play(task, agent, EPISODES).metrics()
    assert isinstance(agent, Controller)
    return exact_metrics(task, agent)
