"""The kernel that all finite POMDPs share: their tables are its data.

A lane's state has two rows: the number of the hidden state, and the number of the symbol that the agent sees now.
Each step takes two uniforms, one for the transition and one for the observation, even where nothing is random.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dpsearch.kernels.lanes import EnvKernel
from dpsearch.kernels.on_demand import on_demand
from dpsearch.pomdp.model import TabularPOMDP

# The head of `ints`: three sizes, then where each table begins. Row S * A of the transitions is the
# distribution of the start state, and the last column of the observation rows is the first observation, so
# that a reset is a transition like any other.
_ACTIONS, _SYMBOLS, _FEATURES = 0, 1, 2
_TRANSITION_STARTS, _NEXT_STATES, _OBSERVATION_ROWS, _SYMBOL_STARTS, _SYMBOL_INDICES, _TERMINAL = (
    3,
    4,
    5,
    6,
    7,
    8,
)
_TRANSITION_CUMULATIVE, _REWARDS, _SYMBOL_CUMULATIVE, _FEATURE_VALUES = 9, 10, 11, 12  # tables in `floats`
_HEAD = 13


@njit(inline="always")
def _at(table, index):
    """``table[index]`` without Numba's test for negative indices, which would double the work here."""
    return table[np.uint64(index)]


@njit(inline="always")
def _entry(ints, starts, row, floats, cumulative, uniform):
    """The entry of a row that a uniform number falls on: the first whose cumulative sum is above it."""
    first = _at(ints, starts + row)
    last = _at(ints, starts + row + 1) - 1
    while first < last:
        middle = (first + last) >> 1
        if uniform < _at(floats, cumulative + middle):
            last = middle
        else:
            first = middle + 1
    return first


@on_demand()
def reset(floats, ints, noise, lane, state):
    """Draws the start state and the first observation of one lane."""
    actions = ints[_ACTIONS]
    starts = ints[_TRANSITION_STARTS]
    last_row = ints[_NEXT_STATES] - starts - 2
    entry = _entry(ints, starts, last_row, floats, ints[_TRANSITION_CUMULATIVE], noise[0, lane])
    place = ints[ints[_NEXT_STATES] + entry]
    row = ints[ints[_OBSERVATION_ROWS] + place * (actions + 1) + actions]
    seen = _entry(ints, ints[_SYMBOL_STARTS], row, floats, ints[_SYMBOL_CUMULATIVE], noise[1, lane])
    state[0, lane] = place
    state[1, lane] = ints[ints[_SYMBOL_INDICES] + seen]


@on_demand()
def observe(floats, ints, state, observation, lanes):
    """Looks up the features of the symbol that each lane sees."""
    for feature in range(ints[_FEATURES]):
        at = ints[_FEATURE_VALUES] + feature * ints[_SYMBOLS]
        for lane in range(lanes):
            observation[feature, lane] = _at(floats, at + np.int64(state[1, lane]))


@on_demand()
def step(floats, ints, noise, action, state, reward, terminated, lanes):
    """Moves the first lanes on. An action out of range counts as the nearest one, so no lookup goes astray."""
    # Read once: the compiler cannot know that writing a state does not change them.
    actions, transition_starts, next_states = ints[_ACTIONS], ints[_TRANSITION_STARTS], ints[_NEXT_STATES]
    observation_rows, symbol_starts = ints[_OBSERVATION_ROWS], ints[_SYMBOL_STARTS]
    symbol_indices, terminal = ints[_SYMBOL_INDICES], ints[_TERMINAL]
    transition_cumulative, rewards = ints[_TRANSITION_CUMULATIVE], ints[_REWARDS]
    symbol_cumulative = ints[_SYMBOL_CUMULATIVE]
    for lane in range(lanes):
        choice = min(max(np.int64(action[0, lane]), 0), actions - 1)
        row = np.int64(state[0, lane]) * actions + choice
        entry = _entry(ints, transition_starts, row, floats, transition_cumulative, noise[0, lane])
        place = _at(ints, next_states + entry)
        row = _at(ints, observation_rows + place * (actions + 1) + choice)
        seen = _entry(ints, symbol_starts, row, floats, symbol_cumulative, noise[1, lane])
        state[0, lane] = place
        state[1, lane] = _at(ints, symbol_indices + seen)
        reward[lane] = _at(floats, rewards + entry)
        terminated[lane] = _at(ints, terminal + place) != 0


@on_demand()
def _accumulate(starts, probabilities, cumulative):
    for row in range(len(starts) - 1):
        total = 0.0
        for entry in range(starts[row], starts[row + 1]):
            total += probabilities[entry]
            cumulative[entry] = total


def _cumulative(starts: NDArray[np.int64], probabilities: NDArray[np.float64]) -> NDArray[np.float64]:
    cumulative = np.empty_like(probabilities)
    _accumulate(starts, probabilities, cumulative)
    return cumulative


def tabular_kernel(pomdp: TabularPOMDP) -> EnvKernel:
    """The compiled dynamics of a model, which all classes and engines play: its tables and the functions above."""
    moves, start, seen = pomdp.transitions, pomdp.start, pomdp.observations
    starts = np.append(moves.starts, moves.starts[-1] + len(start.columns))
    probabilities = np.append(moves.probabilities, start.probabilities)
    n_symbols, n_features = pomdp.features.shape
    int_tables = {
        _TRANSITION_STARTS: starts,
        _NEXT_STATES: np.append(moves.columns, start.columns),
        _OBSERVATION_ROWS: np.column_stack([pomdp.observation_row, pomdp.first_observation_row]).ravel(),
        _SYMBOL_STARTS: seen.starts,
        _SYMBOL_INDICES: seen.columns,
        _TERMINAL: pomdp.terminal.astype(np.int64),
    }
    float_tables = {
        _TRANSITION_CUMULATIVE: _cumulative(starts, probabilities),
        _REWARDS: np.append(pomdp.rewards, np.zeros(len(start.columns))),
        _SYMBOL_CUMULATIVE: _cumulative(seen.starts, seen.probabilities),
        _FEATURE_VALUES: pomdp.features.T.ravel(),
    }
    head = np.zeros(_HEAD, np.int64)
    head[[_ACTIONS, _SYMBOLS, _FEATURES]] = pomdp.n_actions, n_symbols, n_features
    for tables, offset in ((int_tables, _HEAD), (float_tables, 0)):
        lengths = [len(table) for table in tables.values()]
        head[list(tables)] = offset + np.cumsum([0, *lengths[:-1]])
    return EnvKernel(
        reset=reset,
        observe=observe,
        step=step,
        floats=np.concatenate(list(float_tables.values())),
        ints=np.concatenate([head, *int_tables.values()]),
        state_size=2,
        observation_size=n_features,
        draws=2,
    )
