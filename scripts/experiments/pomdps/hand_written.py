"""A hand-written policy for each of the finite POMDPs: what someone would do who has understood the task.

Four are controllers of a few nodes that earn the optimal discounted return. In the other two mazes it takes more than
a few nodes to make the best of what is seen, so there the policies follow the belief, and use what would be best if
the state were seen: QMDP in the 4x3 maze, where nothing better is known, and the most likely state in the 89-state
maze, where it takes twice as long as the best.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from dpsearch.envs import cheese_maze, shuttle, tiger, tmaze
from dpsearch.pomdp.grid import EAST, NORTH, SOUTH, WEST
from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.solvers.agents import Agent, BeliefAgent, Controller
from dpsearch.pomdp.solvers.value_iteration import value_iteration


def tmaze_controller() -> Controller:
    """The T-maze: keeps the sign in mind, walks east, and turns at the junction as the sign said."""
    walk_up, walk_down, turn_up, turn_down = range(4)
    first = np.full(len(tmaze.SYMBOLS), walk_up)
    first[tmaze.SIGN_DOWN] = walk_down
    following = np.array([[walk_up], [walk_down], [turn_up], [turn_down]]).repeat(len(tmaze.SYMBOLS), axis=1)
    following[[walk_up, walk_down], tmaze.JUNCTION] = turn_up, turn_down
    actions = [tmaze.EAST, tmaze.EAST, tmaze.NORTH, tmaze.SOUTH]
    return Controller.deterministic(actions, first, following, len(tmaze.ACTIONS))


def tiger_controller(lead: int = 2) -> Controller:
    """The tiger problem: listens until one side was heard so many times more than the other, and opens the other one.

    Args:
        lead: How many times more. 2 is optimal with a discount of 0.75.

    Raises:
        ValueError: If the lead is below 1.
    """
    if lead < 1:
        raise ValueError(f"the lead must be at least 1, got {lead}")
    leads = np.arange(-lead, lead + 1)  # how many times more the left one was heard; also the nodes, from 0 on
    actions = np.select([leads == lead, leads == -lead], [tiger.OPEN_RIGHT, tiger.OPEN_LEFT], tiger.LISTEN)
    after = np.zeros((len(leads), len(tiger.SYMBOLS)), np.int64)  # what is heard after opening does not count
    listens = actions == tiger.LISTEN
    after[listens, tiger.HEARD_LEFT] = leads[listens] + 1
    after[listens, tiger.HEARD_RIGHT] = leads[listens] - 1
    nothing_heard = np.full(len(tiger.SYMBOLS), lead)
    return Controller.deterministic(actions, nothing_heard, after + lead, len(tiger.ACTIONS))


def shuttle_controller() -> Controller:
    """Shuttle docking: undocks, crosses over, turns round before the station, and backs up until it is docked.

    Backing up is the only manoeuvre of these that may fail, and then the ship is still where it was. So no other
    observation counts than being docked; this is as good as seeing the state.
    """
    plan = [
        shuttle.GO_FORWARD,  # undocks: now at the station, with the back to it
        shuttle.GO_FORWARD,  # into space, facing the other station
        shuttle.GO_FORWARD,  # to that
        shuttle.TURN_AROUND,
        shuttle.BACK_UP,
    ]
    following = np.array([[1], [2], [3], [4], [4]]).repeat(len(shuttle.SYMBOLS), axis=1)
    following[-1, [shuttle.DOCKED_AT_LRV, shuttle.DOCKED_AT_MRV]] = 0
    return Controller.deterministic(plan, np.zeros(len(shuttle.SYMBOLS), np.int64), following, len(shuttle.ACTIONS))


def cheese_controller(pomdp: TabularPOMDP) -> Controller:
    """The cheese maze: goes on until the walls say where to turn; its memory is the direction it goes in.

    Optimal from the dead ends, and from anywhere in discounted return and the thesis's metric. It first tries the
    south where it cannot tell the legs apart: they are three, and one leads to the cheese at once.
    """
    turns = {
        (False, True, True, True): NORTH,  # a foot that is not the cheese's
        (True, False, False, True): EAST,  # the corners
        (True, True, False, False): WEST,
        (True, False, False, False): SOUTH,  # above the cheese
    }
    first_guesses = {(False, True, False, True): SOUTH, (True, False, True, False): EAST}  # in a leg, in the row
    walls = [tuple(value > 0 for value in features) for features in pomdp.features.tolist()]  # N, E, S, W
    following = [[turns.get(seen, heading) for seen in walls] for heading in (NORTH, EAST, SOUTH, WEST)]
    first = [(turns | first_guesses)[seen] for seen in walls]
    return Controller.deterministic([NORTH, EAST, SOUTH, WEST], first, following, len(cheese_maze.ACTIONS))


def qmdp(pomdp: TabularPOMDP) -> BeliefAgent:
    """Takes the action that would be best on average if the state were seen from the next step on.

    It never does anything just to find out where it is. Source: M. L. Littman, A. R. Cassandra and L. P. Kaelbling,
    "Learning policies for partially observable environments: Scaling up", ICML 1995.
    """
    action_values = value_iteration(pomdp).action_values
    return BeliefAgent(pomdp, lambda beliefs: (beliefs @ action_values).argmax(axis=1))


def most_likely_state(pomdp: TabularPOMDP) -> BeliefAgent:
    """Does what would be best in the state that is most likely.

    Unlike QMDP it always takes sides, so it gets to places that tell it that it was wrong. Source: I. Nourbakhsh,
    R. Powers and S. Birchfield, "DERVISH: An office-navigating robot", AI Magazine 16 (2), 1995.
    """
    policy = value_iteration(pomdp).policy
    return BeliefAgent(pomdp, lambda beliefs: policy[beliefs.argmax(axis=1)])


HAND_WRITTEN: Mapping[str, Callable[[TabularPOMDP], Agent]] = MappingProxyType(
    {
        "tmaze": lambda pomdp: tmaze_controller(),
        "tiger": lambda pomdp: tiger_controller(),
        "shuttle": lambda pomdp: shuttle_controller(),
        "cheese": cheese_controller,
        "maze4x3": qmdp,
        "maze89": most_likely_state,
    }
)
"""The policy for each task, by the name that the task's config has; each works for all variants of its task."""
