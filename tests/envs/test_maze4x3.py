from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from dpsearch.envs import Maze4x3
from dpsearch.envs.maze4x3 import CELLS, MINUS, PLUS, Maze4x3Vector, maze4x3_pomdp
from tests.support.exact import solve
from tests.support.twin import require_same

ID = "dpsearch.envs:dpsearch/Maze4x3-v0"
Place = tuple[int, int]  # as in the book: column from the left, row from the bottom, counted from 1
GOOD, BAD, ROCK = (4, 3), (4, 2), (2, 2)


class PlainMaze:
    """The 4x3 maze once more, straight from its definition."""

    def __init__(self, minus_ends: bool, slips: str = "sideways", minus_reward: float = -1.0) -> None:
        self.minus_ends, self.slips, self.minus_reward = minus_ends, slips, minus_reward

    def states(self) -> list[Place]:
        places = [(x, y) for y in (3, 2, 1) for x in (1, 2, 3, 4)]
        return [place for place in places if place not in (GOOD, BAD, ROCK)] + [GOOD, BAD]

    def start(self) -> list[tuple[float, Place]]:
        return [(1 / 9, place) for place in self.states() if place not in (GOOD, BAD)]

    def over(self, state: Place) -> bool:
        return state == GOOD or (self.minus_ends and state == BAD)

    def goes(self, state: Place, right: int, up: int) -> Place:
        place = state[0] + right, state[1] + up
        return place if place in self.states() else state

    def step(self, state: Place, action: int) -> list[tuple[float, Place, float]]:
        compass = [(0, 1), (1, 0), (0, -1), (-1, 0)]
        right, up = compass[action]
        ways = [(0.8, right, up), (0.1, up, right), (0.1, -up, -right)]
        if self.slips == "any_way":
            ways = [(p * q, *compass[way]) for p, meant in slipped(action) for q, way in replaced(meant)]
        ends = [(p, self.goes(state, dx, dy)) for p, dx, dy in ways]
        return [(p, place, {GOOD: 1.0, BAD: self.minus_reward}.get(place, -0.04)) for p, place in ends]

    def sees(self, state: Place, action: int | None) -> list[tuple[float, tuple[float, ...]]]:
        left, right = self.goes(state, -1, 0) == state, self.goes(state, 1, 0) == state
        kinds = [left and not right, right and not left, not left and not right, left and right]
        inner = [float(kind and state not in (GOOD, BAD)) for kind in kinds]
        return [(1.0, (*inner, float(state == GOOD), float(state == BAD)))]


def slipped(action: int) -> list[tuple[float, int]]:
    """Each direction that is a rival of the one intended has a tenth; to the north and east all are, itself too."""
    rivals = [way for way in range(4) if action - way != 2]
    return [(1 - len(rivals) / 10, action), *((0.1, way) for way in rivals)]


def replaced(action: int) -> list[tuple[float, int]]:
    """Any action is replaced by any at random in a tenth of the steps."""
    return [(0.9, action), *((0.1 / 4, way) for way in range(4))]


@pytest.mark.parametrize("minus_ends", [False, True])
@pytest.mark.parametrize("slips", ["sideways", "any_way"])
@pytest.mark.parametrize("minus_reward", [-1.0, -0.04])
def test_the_tables_are_as_the_definition_says(minus_ends: bool, slips: str, minus_reward: float) -> None:
    require_same(maze4x3_pomdp(minus_ends, slips, minus_reward), PlainMaze(minus_ends, slips, minus_reward))


def test_slips_go_any_way_as_often_as_documented() -> None:
    """From cell 7, which has a cell above it and one on either side; to the south it stays."""
    pomdp = maze4x3_pomdp(slips="any_way")
    ways = [pomdp.transition_matrix(action)[7] for action in range(4)]
    north, east, south, west = 4, 8, 7, 6
    expected = [[655, 115, 115, 115], [115, 655, 115, 115], [25, 115, 745, 115], [115, 25, 115, 745]]
    np.testing.assert_allclose([way[[north, east, south, west]] for way in ways], np.array(expected) / 1000)


def test_cells_are_numbered_as_drawn() -> None:
    assert len(CELLS) == 11
    assert (CELLS[PLUS], CELLS[MINUS]) == ((0, 3), (1, 3))
    assert [CELLS[i] for i in (0, 3, 4, 8)] == [(0, 0), (1, 0), (1, 2), (2, 3)]
    assert maze4x3_pomdp().state_names[PLUS] == "+"


def test_values_of_the_cells_are_those_of_the_textbook() -> None:
    """Russell and Norvig pay -0.04 for being in a cell and not for arriving there, hence the difference."""
    utilities = [0.812, 0.868, 0.918, 0.762, 0.660, 0.705, 0.655, 0.611, 0.388]
    values, _ = solve(maze4x3_pomdp(minus_ends=True), 1.0)
    np.testing.assert_allclose(values[:9], np.array(utilities) + 0.04, atol=5.1e-4)


@pytest.mark.parametrize(("minus_ends", "value"), [(False, 0.7630), (True, 0.6976)])
def test_who_sees_the_state_does_better_than_the_best_who_does_not(minus_ends: bool, value: float) -> None:
    pomdp = maze4x3_pomdp(minus_ends)
    assert solve(pomdp, 1.0)[0] @ pomdp.start_distribution() > value


@pytest.mark.parametrize("minus_ends", [False, True])
def test_staying_in_minus_costs_as_much_as_going_there(minus_ends: bool) -> None:
    env, random, stayed = Maze4x3(minus_ends, max_episode_steps=20), np.random.default_rng(0), 0
    for episode in range(300):
        before = env.reset(seed=episode)[1]["state"]
        terminated = truncated = False
        while not (terminated or truncated):
            observation, reward, terminated, truncated, info = env.step(random.integers(4))
            assert reward == {PLUS: 1, MINUS: -1}.get(info["state"], -0.04)
            assert terminated == (info["state"] == PLUS or (minus_ends and info["state"] == MINUS))
            assert observation.tolist()[4:] == [info["state"] == PLUS, info["state"] == MINUS]
            stayed += info["state"] == before == MINUS
            before = info["state"]
    assert (stayed > 0) == (not minus_ends)


@pytest.mark.parametrize("minus_ends", [1, None, "no"])
def test_minus_ends_must_be_true_or_false(minus_ends: Any) -> None:
    for make in (Maze4x3, Maze4x3Vector, lambda minus_ends: gym.make(ID, minus_ends=minus_ends)):
        with pytest.raises(ValueError, match=f"minus_ends must be True or False, got {minus_ends!r}"):
            make(minus_ends=minus_ends)


@pytest.mark.parametrize("slips", ["both ways", None, 3])
def test_slips_go_sideways_or_any_way(slips: Any) -> None:
    with pytest.raises(ValueError, match=f"slips must be one of sideways, any_way, got {slips!r}"):
        Maze4x3(slips=slips)


@pytest.mark.parametrize("minus_reward", [True, None, float("nan"), "-1"])
def test_the_reward_of_minus_must_be_a_finite_number(minus_reward: Any) -> None:
    with pytest.raises(ValueError, match=f"minus_reward must be a finite number, got {minus_reward!r}"):
        Maze4x3(minus_reward=minus_reward)


def test_there_is_a_threshold_for_the_variants_whose_optimum_is_known() -> None:
    assert Maze4x3().reward_threshold == 0.7
    assert Maze4x3(minus_ends=True).reward_threshold == 0.6
    assert Maze4x3(slips="any_way", minus_reward=-0.04).reward_threshold == 0.78
    assert Maze4x3(minus_reward=-0.5).reward_threshold is None
