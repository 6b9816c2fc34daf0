from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dpsearch.envs.cheese_maze import CheeseMaze
from dpsearch.envs.maze4x3 import Maze4x3
from dpsearch.envs.maze89 import Maze89
from dpsearch.envs.shuttle import ShuttleDocking
from dpsearch.envs.tiger import Tiger
from dpsearch.envs.tmaze import TMaze
from dpsearch.pomdp import TabularPOMDP
from dpsearch.pomdp.distributions import Distributions
from dpsearch.pomdp.file_format.reader import read_pomdp_file
from dpsearch.pomdp.file_format.writer import write_pomdp_file
from tests.support.pomdp_texts import FILES, HEAD, MOVES, SEEN, read

TASKS: list[tuple[Any, dict[str, Any]]] = [
    (TMaze, {}),
    (TMaze, {"corridor_length": 1, "encoding": "one_hot"}),
    (TMaze, {"corridor_length": 300}),
    (Tiger, {}),
    (Tiger, {"single": True}),
    (ShuttleDocking, {}),
    (Maze4x3, {}),
    (Maze4x3, {"minus_ends": True}),
    (Maze4x3, {"slips": "any_way"}),
    (CheeseMaze, {}),
    (CheeseMaze, {"start": "anywhere", "bump_reward": 0.0}),
    (Maze89, {}),
]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "x.POMDP"


def assert_same(one: TabularPOMDP, other: TabularPOMDP) -> None:
    """All arrays are equal, to the last bit and in the same order, and so is everything else."""
    for field in fields(TabularPOMDP):
        mine, theirs = getattr(one, field.name), getattr(other, field.name)
        if isinstance(mine, Distributions):
            assert mine.n_columns == theirs.n_columns, field.name
            pairs = [(getattr(mine, name), getattr(theirs, name)) for name in ("starts", "columns", "probabilities")]
        else:
            pairs = [(mine, theirs)]
        for a, b in pairs:
            np.testing.assert_array_equal(a, b, err_msg=field.name, strict=True)


def assert_survives(model: TabularPOMDP, path: Path) -> None:
    write_pomdp_file(model, path)
    assert_same(model, read_pomdp_file(path))
    assert all(len(line) < 10_000 for line in path.read_text().splitlines())


@pytest.mark.parametrize(("task", "arguments"), TASKS, ids=lambda value: getattr(value, "__name__", str(value)))
def test_every_task_can_be_written_and_read_again(path: Path, task: Any, arguments: dict[str, Any]) -> None:
    assert_survives(task.make_task(**arguments).pomdp, path)


def test_random_tables_can_be_written_and_read_again(path: Path, noisy_pomdp: TabularPOMDP) -> None:
    assert_survives(noisy_pomdp, path)


NAMES = ["a", "b c", "b-c", "b_c", "T", "uniform", "3", "", "é", "x/y", "#", "line\nbreak", "nothing", "n3", "*", "a"]


def some_names(random: np.random.Generator, count: int) -> tuple[str, ...]:
    kind = random.integers(3)
    if kind == 0:
        return ()
    if kind == 1:
        return tuple(f"name{number}" for number in range(count))
    return tuple(str(name) for name in random.choice(NAMES, count))


def some_rows(random: np.random.Generator, n_rows: int, n_columns: int) -> Distributions:
    """Rows whose columns are in any order, and may come several times."""
    lengths = random.integers(1, 5, n_rows)
    rows = [random.dirichlet(np.ones(length)) for length in lengths]
    columns = random.integers(n_columns, size=lengths.sum())
    return Distributions(np.append(0, np.cumsum(lengths)), columns, np.concatenate(rows), n_columns)


def some_model(random: np.random.Generator) -> TabularPOMDP:
    """A model in which everything is odd that may be."""
    n_states, n_actions, n_symbols, n_pool = (int(random.integers(1, most)) for most in (7, 4, 5, 6))
    transitions = some_rows(random, n_states * n_actions, n_states)
    if random.random() < 0.5:
        columns = np.repeat(np.arange(n_states), n_actions)  # everything stays where it is
        transitions = Distributions(np.arange(len(columns) + 1), columns, np.ones(len(columns)), n_states)
    rewards = random.integers(-1, 2, len(transitions.columns)) * random.choice([0.0, 1.0, 0.1, 1e-300, 1e30])
    origin = transitions.row_of_entry() // n_actions
    final = np.bincount(origin[(transitions.columns != origin) | (rewards != 0)], minlength=n_states) == 0
    start = some_rows(random, 1, n_states)
    terminal = final & (random.random(n_states) < 0.5)
    terminal[start.columns] = False
    return TabularPOMDP(
        start=start,
        transitions=transitions,
        rewards=rewards,
        observations=some_rows(random, n_pool, n_symbols),
        observation_row=random.integers(n_pool, size=(n_states, n_actions)),
        first_observation_row=random.integers(n_pool, size=n_states),
        features=np.eye(n_symbols) if random.random() < 0.5 else random.normal(size=(n_symbols, 2)),
        terminal=terminal,
        discount=float(random.random()),
        state_names=some_names(random, n_states),
        action_names=some_names(random, n_actions),
        observation_names=some_names(random, n_symbols),
    )


@pytest.mark.parametrize("block", range(5))
def test_odd_models_can_be_written_and_read_again(path: Path, block: int) -> None:
    for seed in range(100 * block, 100 * block + 60):
        assert_survives(some_model(np.random.default_rng(seed)), path)


def test_a_model_from_a_file_needs_no_comments(path: Path) -> None:
    for name in ("tiger", "every_form"):
        model = read_pomdp_file(FILES / f"{name}.POMDP")
        model = replace(model, state_names=())  # of which some of the second have a slash
        assert_survives(model, path)
        assert "\n#dpsearch" not in path.read_text()


def test_a_model_that_sees_nothing_at_the_start_gets_no_further_symbol(path: Path) -> None:
    model = Tiger.make_task().pomdp
    write_pomdp_file(model, path)
    text = path.read_text()
    assert "\nobservations: heard-left heard-right\n" in text
    assert "observation_pool" not in text
    for change in (
        {"features": np.append(model.features[:2], [[1, 1]], axis=0)},
        {"observation_names": ("x", "y", "z")},
        {"first_observation_row": np.array([0, 1])},
    ):
        assert_survives(replace(model, **change), path)
        assert "\nobservations: heard-left heard-right\n" not in path.read_text()


@pytest.mark.parametrize("seed", range(20))
def test_readers_that_pass_over_the_comments_get_the_same_probabilities_and_mean_rewards(path: Path, seed: int) -> None:
    model = some_model(np.random.default_rng(seed))
    write_pomdp_file(model, path)
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    plain = read(path, "\n".join(lines))
    np.testing.assert_allclose(plain.start_distribution(), model.start_distribution(), rtol=1e-12)
    np.testing.assert_allclose(plain.expected_rewards(), model.expected_rewards(), rtol=1e-9, atol=1e-12)
    for action in range(model.n_actions):
        np.testing.assert_allclose(plain.transition_matrix(action), model.transition_matrix(action), rtol=1e-12)
        seen = plain.observation_matrix(action)[:, : model.n_symbols]
        np.testing.assert_allclose(seen, model.observation_matrix(action), rtol=1e-12)


def test_files_are_short_and_can_be_read(path: Path) -> None:
    model = read(path, HEAD + "start: a\n" + MOVES + SEEN + "T : go : a 0.5 0.25 0.25 R : stay : * : * : * 1")
    write_pomdp_file(model, path)
    assert path.read_text().split("\n\n", 1)[1] == (
        HEAD + "\nstart: a\n\n"
        "T : go : a : a 0.5\nT : go : a : b 0.25\nT : go : a : c 0.25\nT : stay : a : a 1.0\n"
        "T : * : b : b 1.0\nT : * : c : c 1.0\n\n"
        "O : * : a : x 0.5\nO : * : a : y 0.5\nO : * : b : x 0.5\nO : * : b : y 0.5\n"
        "O : * : c : x 0.5\nO : * : c : y 0.5\n\n"
        "R : stay : a : * : * 1.0\nR : stay : b : * : * 1.0\nR : stay : c : * : * 1.0\n"
    )


def test_names_that_are_no_words_become_words(path: Path) -> None:
    names = ("a b", "a-b", "T", "3", "é", "a b")
    model = TabularPOMDP.from_dense(np.eye(6)[None], np.ones((1, 6, 1)), [[[0.0]]], np.eye(6)[0], state_names=names)
    assert_survives(model, path)
    assert "\nstates: a-b a-b-1 nT n3 n a-b-5\n" in path.read_text()


def one_state(observations: Distributions, features: NDArray[Any]) -> TabularPOMDP:
    """A model with one state and one action, in which only the observations matter."""
    return TabularPOMDP.from_entries(
        shape=(1, 1),
        start=[1],
        states=0,
        actions=0,
        next_states=0,
        observations=observations,
        observation_row=0,
        first_observation_row=0,
        features=features,
    )


def test_what_could_not_be_read_is_not_written(path: Path) -> None:
    many = 100_001
    model = one_state(Distributions(np.array([0, 1]), np.array([0]), np.ones(1), many), np.zeros((many, 1)))
    with pytest.raises(ValueError, match=r"the model has 100,001 observations: a \.POMDP file may have 100,000"):
        write_pomdp_file(model, path)
    assert not path.exists()
    nothing = replace(Tiger.make_task().pomdp, features=np.zeros((3, 0)))
    with pytest.raises(ValueError, match="the model's features are empty"):
        write_pomdp_file(nothing, path)


def test_many_symbols_need_not_be_as_many_inputs(path: Path) -> None:
    many = 5000
    assert_survives(one_state(Distributions.from_dense(np.eye(1, many)), np.arange(many)[:, None]), path)


def test_a_file_that_cannot_be_written_says_so(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        write_pomdp_file(Tiger.make_task().pomdp, tmp_path / "none" / "x.POMDP")
