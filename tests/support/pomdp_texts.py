"""Pieces of .POMDP files, and what a model that was read says of the joint distribution of what happens."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from dpsearch.pomdp import TabularPOMDP
from dpsearch.pomdp.file_format.reader import read_pomdp_file

FILES = Path(__file__).parent / "pomdp_files"
HEAD = """\
discount: 0.9
values: reward
states: a b c
actions: go stay
observations: x y
"""
MOVES, SEEN = "T : * identity\n", "O : * uniform\n"


def read(path: Path, text: str) -> TabularPOMDP:
    """The model in a text, which is written to a file first."""
    path.write_text(text)
    return read_pomdp_file(path)


def joint(model: TabularPOMDP, states: list[str]) -> dict[tuple[int, int], dict[tuple[int, int, float], float]]:
    """Probability of each (next state, symbol, reward), for every state of the file and action.

    Of the copies of states that rewards for observations take, it makes sure that they are left as the state is.
    """
    file_state = [states.index(name.split("/")[0]) for name in model.state_names]
    seen = model.observations.dense()
    found: dict[tuple[int, int], dict[tuple[int, int, float], float]] = {}
    for state, action in np.ndindex(model.observation_row.shape):
        row = state * model.n_actions + action
        outcomes: dict[tuple[int, int, float], float] = defaultdict(float)
        for entry in range(model.transitions.starts[row], model.transitions.starts[row + 1]):
            arrived = model.transitions.columns[entry]
            for symbol, likely in enumerate(seen[model.observation_row[arrived, action]]):
                if likely:
                    key = (file_state[arrived], symbol, float(model.rewards[entry]))
                    outcomes[key] += float(model.transitions.probabilities[entry] * likely)
        if state < len(states):
            found[state, action] = dict(outcomes)
        elif not model.terminal[state]:
            assert outcomes == found[file_state[state], action]
    return found


def assert_joint(
    found: dict[tuple[int, int], dict[tuple[int, int, float], float]],
    moves: NDArray[np.float64],
    seen: NDArray[np.float64],
    paid: NDArray[np.float64],
) -> None:
    """Compare with the full tables ``[a, s, s']``, ``[a, s', o]`` and ``[a, s, s', o]``."""
    for (state, action), outcomes in found.items():
        expected: dict[tuple[int, int, float], float] = {}
        for following, symbol in np.ndindex(seen.shape[1:]):
            likely = moves[action, state, following] * seen[action, following, symbol]
            if likely > 0:
                expected[following, symbol, float(paid[action, state, following, symbol])] = likely
        assert outcomes == pytest.approx(expected, abs=1e-12)
