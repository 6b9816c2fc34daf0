from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dpsearch.pomdp import PomdpFileError, TabularPOMDP
from dpsearch.pomdp.file_format.reader import read_pomdp_file
from dpsearch.pomdp.kernel import tabular_kernel
from tests.support.pomdp_texts import FILES, HEAD, MOVES, SEEN, assert_joint, joint, read

THIRD = [1 / 3] * 3
EYE = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "x.POMDP"


def transitions(model: TabularPOMDP) -> NDArray[np.float64]:
    """``[action, state, next state]``."""
    return np.stack([model.transition_matrix(action) for action in range(model.n_actions)])


def observations(model: TabularPOMDP) -> NDArray[np.float64]:
    """``[action, next state, symbol]``, without the symbol that is seen at the start only."""
    seen = np.stack([model.observation_matrix(action) for action in range(model.n_actions)])
    assert not seen[:, :, -1].any()
    return seen[:, :, :-1]


# Every form of every statement


@pytest.mark.parametrize(
    ("text", "go", "stay"),
    [
        ("T : * identity", EYE, EYE),
        ("T : go identity T : stay uniform", EYE, [THIRD] * 3),
        ("T : 0 uniform T : 1 : * uniform", [THIRD] * 3, [THIRD] * 3),
        ("T : * identity T : go : b uniform", [[1, 0, 0], THIRD, [0, 0, 1]], EYE),
        ("T : * 0.2 0.3 0.5  1 0 0  0 .25 .75", [[0.2, 0.3, 0.5], [1, 0, 0], [0, 0.25, 0.75]], "go"),
        ("T:go\n0 1 0\n0 0 1\n1 0 0\nT:stay identity", [[0, 1, 0], [0, 0, 1], [1, 0, 0]], EYE),
        ("T : * : * 0.2 0.3 0.5", [[0.2, 0.3, 0.5]] * 3, "go"),
        ("T : * identity T : stay : c 0.2 0.3 0.5", EYE, [[1, 0, 0], [0, 1, 0], [0.2, 0.3, 0.5]]),
        ("T : * identity T : * : 2 0.2 0.3 0.5", [[1, 0, 0], [0, 1, 0], [0.2, 0.3, 0.5]], "go"),
        ("T : * : * : c 1.0", [[0, 0, 1]] * 3, "go"),
        ("T : go : * : b 1 T : stay : * : 0 1", [[0, 1, 0]] * 3, [[1, 0, 0]] * 3),
        ("T : * : a : b 1 T : * : b : b 1 T : * : c : c 1", [[0, 1, 0], [0, 1, 0], [0, 0, 1]], "go"),
        ("T : * : * : * 0.333333333333", [THIRD] * 3, "go"),
        ("T : * identity T : go : a : a .25 T : go : a : c .75", [[0.25, 0, 0.75], [0, 1, 0], [0, 0, 1]], EYE),
        ("T : * identity T : go : a reset start: 0.5 0.5 0", [[0.5, 0.5, 0], [0, 1, 0], [0, 0, 1]], EYE),
        ("start: c T : * reset", [[0, 0, 1]] * 3, "go"),
        # later entries override earlier ones
        ("T : go : a : b 1 T : * identity", EYE, EYE),
        ("T : * uniform T : go identity T : stay : * : * 0 T : stay : * : c 1", EYE, [[0, 0, 1]] * 3),
        ("T : * uniform T : * : * : a 1 T : * : * : b 0 T : * : * : c 0.0", [[1, 0, 0]] * 3, "go"),
        ("T : * : * : c 1 T : go : b : c 0 T : go : b : a 1", [[0, 0, 1], [1, 0, 0], [0, 0, 1]], [[0, 0, 1]] * 3),
        ("T : * identity T : go : b : a 1 T : go : b 0 0 1", [[1, 0, 0], [0, 0, 1], [0, 0, 1]], EYE),
        ("T : * identity T : go : b : a 0.5 T : go : b : a 0", EYE, EYE),
    ],
)
def test_every_form_of_t(path: Path, text: str, go: list[list[float]], stay: list[list[float]] | str) -> None:
    model = read(path, HEAD + SEEN + text)
    np.testing.assert_allclose(transitions(model), np.array([go, go if stay == "go" else stay]), atol=1e-11)


@pytest.mark.parametrize(
    ("text", "go", "stay"),
    [
        ("O : * uniform", [[0.5, 0.5]] * 3, "go"),
        ("O : go 1 0  0 1  .25 .75 O : stay uniform", [[1, 0], [0, 1], [0.25, 0.75]], [[0.5, 0.5]] * 3),
        ("O : * : * 0.9 0.1 O : stay : b uniform", [[0.9, 0.1]] * 3, [[0.9, 0.1], [0.5, 0.5], [0.9, 0.1]]),
        ("O : * : * : x 1.0", [[1, 0]] * 3, "go"),
        ("O : * : * : * .5 O : 0 : 2 : 0 0 O : 0 : 2 : y 1", [[0.5, 0.5], [0.5, 0.5], [0, 1]], [[0.5, 0.5]] * 3),
    ],
)
def test_every_form_of_o(path: Path, text: str, go: list[list[float]], stay: list[list[float]] | str) -> None:
    model = read(path, HEAD + MOVES + text)
    np.testing.assert_array_equal(observations(model), np.array([go, go if stay == "go" else stay]))


def test_observations_may_be_the_states_themselves(path: Path) -> None:
    model = read(path, HEAD.replace("x y", "3") + MOVES + "O : * identity")
    np.testing.assert_array_equal(observations(model), [EYE, EYE])


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", THIRD),
        ("start: uniform", THIRD),
        ("start: 0.2 0.3 0.5", [0.2, 0.3, 0.5]),
        ("start: b", [0, 1, 0]),
        ("start: 2", [0, 0, 1]),
        ("start: 0", [1, 0, 0]),
        ("start include: a c", [0.5, 0, 0.5]),
        ("start include: 1", [0, 1, 0]),
        ("start include: c 2 c", [0, 0, 1]),
        ("start exclude: a 2", [0, 1, 0]),
        ("start exclude : b", [0.5, 0, 0.5]),
        ("start exclude:", THIRD),
    ],
)
def test_every_form_of_start(path: Path, text: str, expected: list[float]) -> None:
    if text == "start exclude:":
        with pytest.raises(PomdpFileError, match="states after start exclude"):
            read(path, HEAD + text + "\n" + MOVES + SEEN)
        return
    np.testing.assert_array_equal(read(path, HEAD + text + "\n" + MOVES + SEEN).start_distribution(), expected)


@pytest.mark.parametrize(
    ("text", "p"), [("start: 0", 1.0), ("start: 1", 1.0), ("start: 1.0", 1.0), ("start: uniform", 1)]
)
def test_a_lone_number_is_the_only_state_or_its_probability(path: Path, text: str, p: float) -> None:
    model = read(path, HEAD.replace("a b c", "1") + text + "\n" + MOVES + SEEN)
    assert model.start_distribution() == [p]


def rewards(*changes: tuple[Any, Any, Any, Any]) -> NDArray[np.float64]:
    """``[action, state, next state]``: zeros, with changes (action, state, next state, reward)."""
    table = np.zeros((2, 3, 3))
    for action, state, following, value in changes:
        table[action, state, following] = value
    return table


ANY = slice(None)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", rewards()),
        ("R : * : * : * : * -1", rewards((ANY, ANY, ANY, -1))),
        ("R : go : a : b : * 2.5", rewards((0, 0, 1, 2.5))),
        ("R : go : a : b 3 3", rewards((0, 0, 1, 3))),
        ("R : stay : 2\n1 1 2 2 3 3", rewards((1, 2, ANY, [1, 2, 3]))),
        ("R : * : b 1 1 2 2 3 3", rewards((ANY, 1, ANY, [1, 2, 3]))),
        ("R : go : * : 1 : * 4", rewards((0, ANY, 1, 4))),
        ("R : * : a : * 5 5", rewards((ANY, 0, ANY, 5))),
        (
            "R : * : * : * : * 1 R : go : * : * : * 2 R : go : a : * : * 3",
            rewards((1, ANY, ANY, 1), (0, ANY, ANY, 2), (0, 0, ANY, 3)),
        ),
        ("R : go : a : * : * 3 R : go : * : * : * 2 R : * : * : c : * 1", rewards((0, ANY, ANY, 2), (ANY, ANY, 2, 1))),
        ("R : go : a : b : x 7 R : go : a : b : y 7", rewards((0, 0, 1, 7))),
        ("R : go : a : b 7 8 R : go : a : b : * 9", rewards((0, 0, 1, 9))),
    ],
)
def test_every_form_of_r(path: Path, text: str, expected: NDArray[np.float64]) -> None:
    model = read(path, HEAD + SEEN + "T : * uniform\n" + text)
    assert model.n_states == 3
    for action in range(2):
        found = model.rewards.reshape(3, 2, 3)[:, action]  # every row has three entries
        np.testing.assert_array_equal(found, expected[action])


def test_costs_are_negative_rewards(path: Path) -> None:
    model = read(path, HEAD.replace("reward", "cost") + MOVES + SEEN + "R : go : * : * : * 3\nR : stay : * : * : * -2")
    np.testing.assert_array_equal(model.expected_rewards(), [[-3, 2]] * 3)
    assert not np.signbit(read(path, HEAD.replace("reward", "cost") + MOVES + SEEN).rewards).any()


# The text


def test_layout_does_not_matter(path: Path) -> None:
    plain = read(
        path, HEAD + "start: a\nT : * : a 0.25 0.75 0\nT : * : b : a 1\nT : * : c : c 1\n" + SEEN + "R:go:a:b:* -1"
    )
    odd = (
        "R\n:go: a:b\n:*- 1#note\nO:*uniform T : * : a # comment T : a\n.25\n\n#all of a line\n\t+7.5E-1 0e0 T:*:b:a 1."
        "T:*:c:c 1\nstart : a observations:x\ny\nactions : go stay states:a b c values : reward discount : 9e-1\n"
    ).replace("1.T", "1. T")
    for text in (odd, odd.replace("\n", "\r\n"), odd.replace("\n", "\r"), "\ufeff" + odd):
        path.write_bytes(text.encode())
        model = read_pomdp_file(str(path))
        np.testing.assert_array_equal(transitions(model), transitions(plain))
        np.testing.assert_array_equal(model.rewards, plain.rewards)
        assert (model.discount, model.state_names, model.action_names) == (0.9, ("a", "b", "c"), ("go", "stay"))


def test_counts_in_place_of_names_give_a_model_without_names(path: Path) -> None:
    head = HEAD.replace("a b c", "3").replace("go stay", "2").replace("x y", "2")
    model = read(path, head + "start: 1 T : * : * : 0 1 O : * : * : 1 1")
    assert (model.state_names, model.action_names, model.observation_names) == ((), (), ())
    np.testing.assert_array_equal(model.start_distribution(), [0, 1, 0])


def test_probabilities_with_few_digits_are_made_to_sum_to_1(path: Path) -> None:
    text = HEAD + "start: 0.333333 0.333333 0.333332 T : * : * .333333 .333333 .33333 O : * : * 0.5 0.5"
    model = read(path, text)
    np.testing.assert_allclose(transitions(model).sum(axis=2), 1, atol=1e-12)
    np.testing.assert_allclose(model.start_distribution().sum(), 1, atol=1e-12)
    with pytest.raises(PomdpFileError, match=r"sum to 0\.99998, not 1"):
        read(path, text.replace("0.5 0.5", "0.5 0.49998"))


# What the format does not say


def test_nothing_is_seen_before_the_first_action(path: Path) -> None:
    model = read(path, HEAD + MOVES + SEEN)
    np.testing.assert_array_equal(model.first_observation_matrix(), [[0, 0, 1]] * 3)
    np.testing.assert_array_equal(model.features, [[1, 0], [0, 1], [0, 0]])
    assert model.observation_names == ("x", "y", "nothing")
    assert read(path, HEAD.replace("x y", "x nothing") + MOVES + SEEN).observation_names == (
        "x",
        "nothing",
        "nothing-yet",
    )


@pytest.mark.parametrize(
    ("text", "terminal"),
    [
        ("start: a", [False, True, True]),
        ("start: uniform", [False, False, False]),
        ("", [False, False, False]),
        ("start exclude: c", [False, False, True]),
        ("start: a R : stay : b : * : * 1", [False, False, True]),
        ("start: a R : stay : b : b : x 1", [False, False, True]),
        ("start: a R : stay : b : a : * 1", [False, True, True]),
        ("start: a T : stay : b .5 .5 0", [False, False, True]),
    ],
)
def test_states_without_a_way_out_and_without_reward_end_the_episode(
    path: Path, text: str, terminal: list[bool]
) -> None:
    model = read(path, HEAD + MOVES + SEEN + text)
    np.testing.assert_array_equal(model.terminal[:3], terminal)


def test_rewards_for_observations_split_only_the_states_that_need_it(path: Path) -> None:
    model = read(
        path,
        HEAD.replace("a b c", "a b")
        + "start: a T : * uniform T : stay identity O : go .25 .75 .5 .5 O : stay : * : x 1\n"
        "R : go : a : b 1 -1\nR : stay : * : * : x 5\nR : go : a : a : * 2",
    )
    assert model.state_names == ("a", "b", "b/x", "b/y")
    assert joint(model, ["a", "b"])[0, 0] == {
        (0, 0, 2.0): 0.125,
        (0, 1, 2.0): 0.375,
        (1, 0, 1.0): 0.25,
        (1, 1, -1.0): 0.25,
    }
    assert joint(model, ["a", "b"])[0, 1] == {(0, 0, 5.0): 1.0}
    np.testing.assert_array_equal(model.transition_matrix(0)[0], [0.5, 0, 0.25, 0.25])
    np.testing.assert_array_equal(model.transition_matrix(0)[2:, :2], [[0.5, 0.5]] * 2)  # they go on as b does
    np.testing.assert_array_equal(model.transition_matrix(1)[2:, :2], [[0, 1]] * 2)
    np.testing.assert_array_equal(model.observation_matrix(0)[2:], [[1, 0, 0], [0, 1, 0]])
    np.testing.assert_array_equal(model.start_distribution(), [1, 0, 0, 0])


def test_copies_of_terminal_states_are_terminal(path: Path) -> None:
    text = "start: 0 T : * : * : 1 1 O : * uniform R : * : 0 : 1 : 0 1"
    model = read(path, HEAD.replace("a b c", "2").replace("x y", "2") + text)
    assert model.state_names == ("0", "1", "1/0", "1/1")
    np.testing.assert_array_equal(model.terminal, [False, True, True, True])
    np.testing.assert_array_equal(model.transition_matrix(0)[1:], np.eye(4)[1:])
    assert joint(model, ["0", "1"])[0, 0] == {(1, 0, 1.0): 0.5, (1, 1, 0.0): 0.5}


# Whole files, against tables written by hand and against a twin that keeps full tables


def test_the_tiger_problem_is_what_its_definition_says() -> None:
    model = read_pomdp_file(FILES / "tiger.POMDP")
    half = [[0.5, 0.5], [0.5, 0.5]]
    twin = TabularPOMDP.from_dense(
        transitions=[[[1.0, 0.0], [0.0, 1.0]], half, half],
        observations=[[[0.85, 0.15], [0.15, 0.85]], half, half],
        rewards=[[[-1], [-1]], [[-100], [10]], [[10], [-100]]],
        start=[0.5, 0.5],
        discount=0.95,
        state_names=("tiger-left", "tiger-right"),
        action_names=("listen", "open-left", "open-right"),
        observation_names=("hear-left", "hear-right"),
    )
    np.testing.assert_array_equal(tabular_kernel(model).floats, tabular_kernel(twin).floats)
    np.testing.assert_array_equal(tabular_kernel(model).ints, tabular_kernel(twin).ints)
    for name in ("discount", "state_names", "action_names", "observation_names"):
        assert getattr(model, name) == getattr(twin, name)


def test_a_file_with_every_form_is_what_its_statements_say() -> None:
    model = read_pomdp_file(FILES / "every_form.POMDP")
    states = ["good", "worn", "broken", "scrap"]
    moves = np.zeros((3, 4, 4))
    moves[:, 3, 3] = 1
    moves[0, :3] = [[0.7, 0.2, 0.1, 0.0], [0.0, 0.25, 0.5, 0.25], [0.25, 0.25, 0.25, 0.25]]
    moves[1, :3] = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.5, 0.5, 0.0, 0.0]]
    moves[2] = np.eye(4)
    seen = np.full((3, 4, 3), 1 / 3)
    seen[0, 1] = [0.5, 0, 0.5]
    seen[1, 0] = [0.25, 0.25, 0.5]
    seen[2] = [[1, 0, 0], [0.5, 0.5, 0], [0, 0, 1], [0, 0, 1]]
    costs = np.ones((3, 4, 4, 3))
    costs[0, 0] = -2.5
    costs[1, 2, 1] = [5, 6, 7]
    costs[2, 1] = [[1, 1, 1], [-2, 2, 2], [3, 3, 3], [4, 4, 4]]
    costs[:, 3] = 0
    assert model.discount == 0.9
    np.testing.assert_array_equal(model.start_distribution(), [0.5, 0.5] + [0] * (model.n_states - 2))
    np.testing.assert_array_equal(np.flatnonzero(model.terminal), [3])
    assert_joint(joint(model, states), moves, seen, -costs)
    copies = ["worn/0", "worn/1", "worn/2"]  # after repairing 5, 6 and 7, after inspecting -2 and 2
    assert list(model.state_names) == [*states, *copies]


def test_large_models_stay_sparse(path: Path) -> None:
    n = 5000
    text = (
        f"discount: 1 values: reward states: {n} actions: 4 observations: 30 start: 0\n"
        "T : * identity T : 1 : * : 7 0.5\n"
        + "\n".join(f"T : 1 : {s} : {s} 0.5" for s in range(n) if s != 7)
        + " T : 1 : 7 : 7 1 T : 2 : * reset O : * uniform O : 3 : * : * 0 O : 3 : * : 4 1 R : * : * : * : * -1"
    )
    model = read(path, text)
    assert len(model.transitions.columns) == 5 * n - 1
    assert model.observations.n_rows == 3
    np.testing.assert_array_equal(model.rewards, -1)
    row = slice(*model.transitions.starts[4 * 9 + 1 : 4 * 9 + 3])
    np.testing.assert_array_equal(model.transitions.columns[row], [7, 9])
