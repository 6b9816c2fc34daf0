"""Compares the tables of a task with its definition, written once more in plain Python."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable
from typing import Protocol, TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray

from dpsearch.pomdp import TabularPOMDP

State = TypeVar("State", bound=Hashable)
Inputs = tuple[float, ...]


class Twin(Protocol[State]):
    """A task, with states of any kind."""

    def states(self) -> Iterable[State]:
        """All states, in the order in which the tables number them."""

    def start(self) -> Iterable[tuple[float, State]]:
        """Probabilities of the states in which an episode may begin."""

    def over(self, state: State) -> bool:
        """Whether the episode is over."""

    def step(self, state: State, action: int) -> Iterable[tuple[float, State, float]]:
        """What may come of an action in a state in which the episode is not over: probability, state, reward."""

    def sees(self, state: State, action: int | None) -> Iterable[tuple[float, Inputs]]:
        """Probabilities of what is seen on arriving in a state by an action, or at the start (None)."""


def require_same(pomdp: TabularPOMDP, twin: Twin[State]) -> None:
    """The tables have the probabilities of the definition and no others, for all states, actions and symbols."""
    states = list(twin.states())
    number = {state: i for i, state in enumerate(states)}
    assert len(number) == pomdp.n_states
    assert [twin.over(state) for state in states] == pomdp.terminal.tolist()
    start = pomdp.start_distribution()
    require_equal(enumerate(start.tolist()), ((number[state], p) for p, state in twin.start()))
    for i, state in enumerate(states):
        for action in range(pomdp.n_actions):
            _require_same_sight(pomdp, pomdp.observation_matrix(action)[i], twin.sees(state, action))
            if not twin.over(state):
                row = i * pomdp.n_actions + action
                entries = range(pomdp.transitions.starts[row], pomdp.transitions.starts[row + 1])
                found = (((int(pomdp.transitions.columns[e]), float(pomdp.rewards[e])), e) for e in entries)
                require_equal(
                    ((outcome, float(pomdp.transitions.probabilities[e])) for outcome, e in found),
                    (((number[after], reward), p) for p, after, reward in twin.step(state, action)),
                )
        if start[i] > 0:
            _require_same_sight(pomdp, pomdp.first_observation_matrix()[i], twin.sees(state, None))


def _require_same_sight(
    pomdp: TabularPOMDP, symbols: NDArray[np.float64], expected: Iterable[tuple[float, Inputs]]
) -> None:
    inputs = (tuple(row) for row in pomdp.features.tolist())
    require_equal(zip(inputs, symbols.tolist(), strict=True), ((what, p) for p, what in expected))


def require_equal(found: Iterable[tuple[Hashable, float]], expected: Iterable[tuple[Hashable, float]]) -> None:
    """Two distributions are the same: pairs of an outcome and a probability; those of one outcome add up."""
    sums: tuple[dict[Hashable, float], dict[Hashable, float]] = defaultdict(float), defaultdict(float)
    for total, pairs in zip(sums, (found, expected), strict=True):
        for outcome, probability in pairs:
            if probability > 0:
                total[outcome] += probability
    assert dict(sums[0]) == pytest.approx(dict(sums[1]), abs=1e-12)
