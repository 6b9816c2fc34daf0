from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from dpsearch.envs import CheeseMaze
from dpsearch.envs.cheese_maze import CELLS, CHEESE, SYMBOLS, CheeseMazeVector, cheese_maze_pomdp
from dpsearch.pomdp.grid import EAST, NORTH, SOUTH, WEST
from dpsearch.pomdp.solvers.agents import Controller
from dpsearch.pomdp.solvers.exact import exact_metrics
from tests.support.exact import Machine, machine, play
from tests.support.twin import require_same

ID = "dpsearch.envs:dpsearch/CheeseMaze-v0"
Place = tuple[int, int]  # column from the left, steps down from the top
GOAL = (2, 2)


class PlainCheeseMaze:
    """The cheese maze once more, straight from its definition."""

    def __init__(self, start: str, bump_reward: float) -> None:
        self.where, self.bump_reward = start, bump_reward

    def states(self) -> list[Place]:
        return [(x, 0) for x in range(5)] + [(x, y) for y in (1, 2) for x in (0, 2, 4)]

    def start(self) -> list[tuple[float, Place]]:
        if self.where == "dead_ends":
            return [(0.5, (0, 2)), (0.5, (4, 2))]
        return [(0.1, place) for place in self.states() if place != GOAL]

    def over(self, state: Place) -> bool:
        return state == GOAL

    def beyond(self, state: Place, action: int) -> Place | None:
        right, down = [(0, -1), (1, 0), (0, 1), (-1, 0)][action]
        place = state[0] + right, state[1] + down
        return place if place in self.states() else None

    def step(self, state: Place, action: int) -> list[tuple[float, Place, float]]:
        place = self.beyond(state, action)
        if place is None:
            return [(1.0, state, self.bump_reward)]
        return [(1.0, place, 1.0 if place == GOAL else 0.0)]

    def sees(self, state: Place, action: int | None) -> list[tuple[float, tuple[float, ...]]]:
        return [(1.0, tuple(1.0 if self.beyond(state, side) is None else -1.0 for side in range(4)))]


@pytest.mark.parametrize(("start", "bump_reward"), [("dead_ends", -1.0), ("anywhere", 0.0), ("anywhere", -0.3)])
def test_the_tables_are_as_the_definition_says(start: str, bump_reward: float) -> None:
    require_same(cheese_maze_pomdp(start, bump_reward), PlainCheeseMaze(start, bump_reward))


def test_six_patterns_of_walls_can_be_told_apart() -> None:
    pomdp = cheese_maze_pomdp()
    assert SYMBOLS == (
        "walls north, west",
        "walls north, south",
        "wall north",
        "walls north, east",
        "walls east, west",
        "walls east, south, west",
    )
    looks = pomdp.first_observation_matrix().argmax(axis=1).tolist()
    assert looks == [0, 1, 2, 1, 3, 4, 4, 4, 5, 5, 5]
    assert (CELLS[8], CELLS[CHEESE], CELLS[10]) == ((2, 0), (2, 2), (2, 4))


def follow_the_walls(in_a_leg: int) -> Machine:
    """Up the leg, along the corridor, down the middle, remembering the way; ``in_a_leg`` is for starts within one."""
    ways = {"walls north, west": EAST, "walls north, south": EAST, "walls north, east": WEST, "wall north": SOUTH}

    def first(symbol: int) -> int:
        return ways.get(SYMBOLS[symbol], in_a_leg if SYMBOLS[symbol] == "walls east, west" else NORTH)

    def following(way: int, symbol: int) -> int:
        if SYMBOLS[symbol] == "walls east, south, west":
            return NORTH
        if SYMBOLS[symbol] in ("walls east, west", "walls north, south"):
            return way
        return ways[SYMBOLS[symbol]]

    return machine(cheese_maze_pomdp(), first, lambda way: way, following)


def test_the_cheese_is_six_steps_from_a_dead_end() -> None:
    play(cheese_maze_pomdp(), follow_the_walls(NORTH), 500).require("1.00000 0.16667 0.16667 0.16807 6.00000")


@pytest.mark.parametrize("bump_reward", [0.0, -1.0])
@pytest.mark.parametrize(
    ("in_a_leg", "printed"),
    [(SOUTH, "1.00000 0.22222 0.31524 0.36875 4.50000"), (NORTH, "1.00000 0.23256 0.26000 0.34224 4.30000")],
)
def test_the_cheese_can_be_found_from_anywhere_without_a_bump(bump_reward: float, in_a_leg: int, printed: str) -> None:
    """Trying a leg downwards is optimal with discount, upwards it takes the fewest steps."""
    play(cheese_maze_pomdp("anywhere", bump_reward), follow_the_walls(in_a_leg), 500).require(printed)


def test_the_agent_starts_where_it_was_asked_to() -> None:
    for start, cells in (("dead_ends", {8, 10}), ("anywhere", set(range(11)) - {CHEESE})):
        states = CheeseMazeVector(num_envs=5000, start=start).reset(seed=0)[1]["state"]
        found, counts = np.unique(states, return_counts=True)
        assert set(found.tolist()) == cells
        assert np.allclose(counts / 5000, 1 / len(cells), atol=0.03)


def test_walls_hurt_as_much_as_was_asked_for() -> None:
    for bump_reward in (-1.0, 0.0, -0.25, 2):
        env = CheeseMaze(bump_reward=bump_reward)
        before = env.reset(seed=1)[1]["state"]
        _, reward, terminated, _, info = env.step(SOUTH)
        assert (reward, terminated, info["state"]) == (bump_reward, False, before)
    env = CheeseMaze(bump_reward=-0.25)
    east_or_west = EAST if env.reset(seed=1)[1]["state"] == 8 else WEST
    steps = [env.step(a) for a in (NORTH, NORTH, east_or_west, east_or_west, SOUTH, SOUTH)]
    assert [step[1] for step in steps] == [0, 0, 0, 0, 0, 1]
    assert [step[2] for step in steps] == [False] * 5 + [True]


def test_a_wall_seen_is_1_and_none_is_minus_1() -> None:
    env = CheeseMaze()
    assert env.observation_space == gym.spaces.Box(-1, 1, (4,), np.float32)
    assert env.reset(seed=0)[0].tolist() == [-1, 1, 1, 1]


@pytest.mark.parametrize("start", ["everywhere", "", None, 8])
def test_an_unknown_start_is_refused(start: Any) -> None:
    for make in (CheeseMaze, CheeseMazeVector, lambda start: gym.make(ID, start=start)):
        with pytest.raises(ValueError, match=f"start must be one of dead_ends, anywhere, got {start!r}"):
            make(start=start)


@pytest.mark.parametrize("bump_reward", [float("nan"), float("inf"), -float("inf"), "-1", None, True])
def test_a_reward_that_is_no_finite_number_is_refused(bump_reward: Any) -> None:
    for make in (CheeseMaze, CheeseMazeVector, lambda bump_reward: gym.make(ID, bump_reward=bump_reward)):
        with pytest.raises(ValueError, match=f"bump_reward must be a finite number, got {bump_reward!r}"):
            make(bump_reward=bump_reward)


def test_solving_it_means_hardly_a_bump_if_bumps_cost_anything() -> None:
    assert CheeseMaze().reward_threshold == 0.9
    assert CheeseMaze(start="anywhere", bump_reward=-0.5).reward_threshold == 0.95
    env = gym.make(ID, start="anywhere", bump_reward=0.0)
    assert env.spec is not None
    assert env.spec.reward_threshold is None  # a random policy finds it as well, in the end


def test_care_without_memory_finds_the_cheese_after_20_steps() -> None:
    """At random between walls, and south where the cheese is below: what its discounted return is worth."""
    task = CheeseMaze.make_task()
    policy = (task.pomdp.features < 0).astype(float)  # where there is no wall
    policy[task.pomdp.observation_names.index("wall north")] = np.eye(4)[2]
    found = exact_metrics(task, Controller.memoryless(policy / policy.sum(axis=1, keepdims=True)))
    assert found.episode_return.value == pytest.approx(1.0, abs=1e-6)
    assert found.steps.value == pytest.approx(20.0, abs=1e-3)
    assert found.discounted_return.value == pytest.approx(0.026, abs=5e-4)
