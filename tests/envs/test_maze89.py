from __future__ import annotations

import itertools
import math

import gymnasium as gym
import numpy as np
import pytest
from scipy import stats

from dpsearch.envs import Maze89
from dpsearch.envs.maze89 import CELLS, DO_NOTHING, GOAL, HEADINGS, SYMBOLS, Maze89Vector, maze89_pomdp
from tests.support.exact import at_random, chain_of, play, solve
from tests.support.twin import require_same

ID = "dpsearch.envs:dpsearch/Maze89-v0"
DRAWING = """\
. * * * * * .
* * . * . * *
. * . * . * .
* * . * . * G
. * * * * * ."""
State = tuple[complex, complex]  # place, to the right and up; and heading, likewise
NORTH = 1j


class PlainMaze89:
    """The 89-state maze once more, straight from its definition, in the plane of complex numbers."""

    def __init__(self) -> None:
        marks = {
            complex(x, -y): mark
            for y, line in enumerate(DRAWING.splitlines())
            for x, mark in enumerate(line.split())
            if mark != "."
        }
        self.cells = [place for place, mark in marks.items() if mark == "*"]
        (self.goal,) = (place for place, mark in marks.items() if mark == "G")

    def arrive(self, place: complex, heading: complex) -> State:
        return (place, 1) if place == self.goal else (place, heading)

    def states(self) -> list[State]:
        return [(place, NORTH * (-1j) ** i) for place in self.cells for i in range(4)] + [(self.goal, 1)]

    def start(self) -> list[tuple[float, State]]:
        return [(1 / 88, state) for state in self.states()[:-1]]

    def over(self, state: State) -> bool:
        return state[0] == self.goal

    def is_wall(self, place: complex) -> bool:
        return place not in self.cells and place != self.goal

    def step(self, state: State, action: int) -> list[tuple[float, State, float]]:
        left, right, about, same = 1j, -1j, -1, 1
        turns: dict[int, list[tuple[float, complex]]] = {
            1: [(0.7, left), (0.1, right), (0.1, about), (0.1, same)],
            2: [(0.7, right), (0.1, left), (0.1, about), (0.1, same)],
            3: [(0.6, about), (0.15, left), (0.15, right), (0.1, same)],
            4: [(1.0, same)],
        }
        moves = [
            (0.8, same, same),
            (0.05, left, left),
            (0.05, right, right),
            (0.025, about, same),
            (0.025, about, about),
        ]
        place, heading = state
        if action == 0:
            ends = [(0.05, state)]
            for p, way, turn in moves:
                beyond = place + heading * way
                ends.append((p, state if self.is_wall(beyond) else self.arrive(beyond, heading * turn)))
        else:
            ends = [(p, (place, heading * turn)) for p, turn in turns[action]]
        return [(p, after, 1.0 if after[0] == self.goal else 0.0) for p, after in ends]

    def sees(self, state: State, action: int | None) -> list[tuple[float, tuple[float, ...]]]:
        sides = [self.is_wall(state[0] + state[1] * side) for side in (1, -1j, -1, 1j)]  # front, right, back, left
        found = []
        for bits in itertools.product((0.0, 1.0), repeat=4):
            ones = [0.9 if wall else 0.05 for wall in sides]
            found.append((math.prod(p if bit else 1 - p for p, bit in zip(ones, bits, strict=True)), bits))
        return found


def test_the_tables_are_as_the_definition_says() -> None:
    require_same(maze89_pomdp(), PlainMaze89())


def test_states_are_numbered_by_cell_and_heading() -> None:
    pomdp = maze89_pomdp()
    assert (len(CELLS), pomdp.n_states, GOAL) == (23, 89, 88)
    assert (CELLS[0], CELLS[6], CELLS[GOAL // 4]) == ((0, 1), (1, 1), (3, 6))
    assert pomdp.state_names[4 * 6 + 1] == "cell 6, facing east"
    assert (pomdp.state_names[GOAL], HEADINGS[2]) == ("goal", "south")
    assert SYMBOLS[0b1001] == "walls front, left"


def test_who_sees_the_state_needs_thirteen_steps() -> None:
    pomdp = maze89_pomdp()
    values, policy = solve(pomdp, 0.98)
    assert values @ pomdp.start_distribution() == pytest.approx(0.79605, abs=6e-6)
    chain = chain_of(pomdp, policy)
    play(chain, at_random(chain), 251).require("1.00000 0.07894 0.11476 0.79605 12.66836")
    half, rest = (play(chain, at_random(chain), steps).mean_return for steps in (12, 11))
    assert rest < 0.5 <= half  # the median


def test_walls_are_seen_as_often_as_they_should_be() -> None:
    """By whoever faces the end of a dead end, cell 5: walls in front, right and left; at the start and later."""
    n, state = 200_000, 4 * 5 + 3
    expected = maze89_pomdp().first_observation_matrix()[state]
    assert expected[0b1101] == pytest.approx(0.9**3 * 0.95)
    assert expected[0b1111] == pytest.approx(0.9**3 * 0.05)
    env = Maze89Vector(num_envs=n)
    first, info = env.reset(seed=0)
    second, *_ = env.step(np.full(n, DO_NOTHING))
    for observations in (first, second):
        symbols = observations[info["state"] == state] @ np.array([8, 4, 2, 1])
        assert len(symbols) > 2000
        counts, likely = np.bincount(symbols.astype(np.int64), minlength=16), expected > 0.005
        gathered = [np.append(what[likely], what[~likely].sum()) for what in (counts, expected * len(symbols))]
        assert stats.chisquare(*gathered).pvalue > 1e-4


def test_all_starts_are_equally_likely_and_the_goal_is_none() -> None:
    states = Maze89Vector(num_envs=100_000).reset(seed=1)[1]["state"]
    counts = np.bincount(states, minlength=89)
    assert counts[GOAL] == 0
    assert stats.chisquare(counts[:GOAL]).pvalue > 1e-3


def test_an_episode_ends_with_reward_1_at_the_goal_and_after_251_steps() -> None:
    _, policy = solve(maze89_pomdp(), 0.98)
    env = Maze89()
    assert env.observation_space == gym.spaces.Box(0, 1, (4,), np.float32)
    for seed in range(20):
        info, terminated = env.reset(seed=seed)[1], False
        while not terminated:
            _, reward, terminated, truncated, info = env.step(policy[info["state"]])
            assert reward == float(terminated) == float(info["state"] == GOAL)
            assert not truncated
    env.reset(seed=0)
    assert [env.step(DO_NOTHING)[3] for _ in range(251)] == [False] * 250 + [True]
