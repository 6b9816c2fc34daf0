from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.support.pomdp_texts import assert_joint, joint, read


def field(random: np.random.Generator, names: str) -> tuple[str, slice]:
    """A name, a number or an asterisk, and what it stands for."""
    number = int(random.integers(len(names)))
    kind = random.integers(4)
    if kind == 0:
        return "*", slice(None)
    return (names[number] if kind < 3 else str(number)), slice(number, number + 1)


def numbers(values: NDArray[np.float64]) -> str:
    return " ".join(repr(value) for value in values.ravel().tolist())


def probability_statements(
    random: np.random.Generator, keyword: str, table: NDArray[np.float64], start: NDArray[np.float64], columns: str
) -> Iterator[str]:
    """Random statements of all forms, which also change the full table ``[action, state, column]``."""
    _, n_states, n_columns = table.shape
    for _ in range(int(random.integers(1, 40))):
        (action, a), (state, s), (column, c) = field(random, "AB"), field(random, "abcd"), field(random, columns)
        match random.integers(8):
            case 0:
                table[a] = 1 / n_columns
                yield f"{keyword} : {action} uniform"
            case 1:
                table[a, s] = 1 / n_columns
                yield f"{keyword} : {action} : {state} uniform"
            case 2 if n_columns == n_states:
                table[a] = np.eye(n_states)
                yield f"{keyword} : {action} identity"
            case 3 if keyword == "T":
                table[a, s] = start
                yield f"T : {action} : {state} reset"
            case 4:
                table[a] = rows = random.dirichlet(np.ones(n_columns), n_states)
                yield f"{keyword} : {action} {numbers(rows)}"
            case 5:
                table[a, s] = row = random.dirichlet(np.ones(n_columns))
                yield f"{keyword} : {action} : {state} {numbers(row)}"
            case _:
                value = float(random.choice([0, 0.25, 0.5, 1 / n_columns, 1]))
                table[a, s, c] = value
                yield f"{keyword} : {action} : {state} : {column} {value!r}"
    for action_, state_ in np.ndindex(table.shape[:2]):  # mend what is no distribution, by single entries
        if abs(table[action_, state_].sum() - 1) > 1e-9:
            for number in range(n_columns):
                if table[action_, state_, number] or number == 1:
                    table[action_, state_, number] = float(number == 1)
                    yield f"{keyword} : {action_} : {state_} : {number} {float(number == 1)}"


def reward_statements(random: np.random.Generator, table: NDArray[np.float64]) -> Iterator[str]:
    """Random statements of all forms, which also change the full table ``[action, state, next state, symbol]``."""
    for _ in range(int(random.integers(12))):
        (action, a), (state, s), (following, f) = field(random, "AB"), field(random, "abcd"), field(random, "abcd")
        symbol, o = field(random, "xyz")
        match random.integers(5):
            case 0:
                values = random.integers(-3, 4, (4, 3)).astype(float)
                table[a, s] = values
                yield f"R : {action} : {state} {numbers(values)}"
            case 1:
                row = random.integers(-3, 4, 3).astype(float)
                table[a, s, f] = row
                yield f"R : {action} : {state} : {following} {numbers(row)}"
            case _:
                value = float(random.integers(-3, 4))
                table[a, s, f, o] = value
                yield f"R : {action} : {state} : {following} : {symbol} {value!r}"


@pytest.mark.parametrize("block", range(6))
def test_statements_in_any_mixture_mean_what_a_twin_with_full_tables_says(tmp_path: Path, block: int) -> None:
    for seed in range(100 * block, 100 * block + 50):
        random = np.random.default_rng(seed)
        start = random.dirichlet(np.ones(4))
        moves, seen, paid = np.zeros((2, 4, 4)), np.zeros((2, 4, 3)), np.zeros((2, 4, 4, 3))
        lines = [
            *probability_statements(random, "T", moves, start, "abcd"),
            *probability_statements(random, "O", seen, start, "xyz"),
            *reward_statements(random, paid),
        ]
        head = "discount: 1 values: reward states: a b c d actions: A B observations: x y z start: " + numbers(start)
        model = read(tmp_path / "x.POMDP", "\n".join([head, *lines]))
        assert_joint(joint(model, list("abcd")), moves, seen, paid)
