from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from dpsearch.pomdp import PomdpFileError
from tests.support.pomdp_texts import HEAD, MOVES, SEEN, read

# A valid file with every comment: two transitions of the first row have the same next state, and different rewards
COMMENTS = {
    "state_names": '["one", "two words", "three"]',
    "action_names": '["go", "stay put"]',
    "observation_names": '["x", "why"]',
    "features": "[[1, 2], [3, 4]]",
    "terminal": "[2]",
    "start": "[[1, 0.5], [0, 0.25], [0, 0.25]]",
    "transitions": "[[0, 0, [[1, 0.25, 1], [0, 0.5, 0], [1, 0.25, 3]]]]",
    "observation_pool": "[[[1, 1]], [[1, 0.5], [0, 0.5]]]",
    "observation_row": "[[1, 1], [1, 1], [1, 1]]",
    "first_observation_row": "[0, 0, 0]",
}
STATEMENTS = "start: 0.5 0.5 0\n" + MOVES + SEEN + "T : go : a 0.5 0.5 0\nR : go : a : b : * 2\nR:stay:b:b:* 1\n"


def text(**changes: str) -> str:
    """The file, with some comments changed; they begin in line 6."""
    comments = {**COMMENTS, **changes}
    return HEAD + "".join(f"#dpsearch: {key} {value}\n" for key, value in comments.items() if value) + STATEMENTS


def test_comments_say_what_the_format_cannot(tmp_path: Path) -> None:
    model = read(tmp_path / "x.POMDP", text())
    assert model.state_names == ("one", "two words", "three")
    assert model.action_names == ("go", "stay put")
    assert model.observation_names == ("x", "why")
    np.testing.assert_array_equal(model.features, [[1, 2], [3, 4]])
    np.testing.assert_array_equal(model.terminal, [False, False, True])
    np.testing.assert_array_equal(model.start.columns, [1, 0, 0])
    np.testing.assert_array_equal(model.start.probabilities, [0.5, 0.25, 0.25])
    np.testing.assert_array_equal(model.transitions.columns[:4], [1, 0, 1, 0])
    np.testing.assert_array_equal(model.rewards[:4], [1, 0, 3, 0])
    np.testing.assert_array_equal(model.observations.dense(), [[0, 1], [0.5, 0.5]])
    np.testing.assert_array_equal(model.observations.columns, [1, 1, 0])
    np.testing.assert_array_equal(model.observation_row, [[1, 1]] * 3)
    np.testing.assert_array_equal(model.first_observation_row, [0, 0, 0])


def test_a_list_may_be_continued_and_comments_may_stand_anywhere(tmp_path: Path) -> None:
    one = text(terminal="", observation_row="[1, 1]")
    model = read(tmp_path / "x.POMDP", "#dpsearch: terminal []\n" + one + "  #dpsearch: observation_row [1]")
    np.testing.assert_array_equal(model.observation_row, [[1, 1]] * 3)
    assert not model.terminal.any()


def test_other_comments_are_passed_over(tmp_path: Path) -> None:
    model = read(tmp_path / "x.POMDP", HEAD + "# dpsearch: bogus\n#dpsearch\n" + MOVES + "#x #dpsearch: bogus\n" + SEEN)
    assert model.n_states == 3


def refused(tmp_path: Path, content: str, line: int | None, message: str) -> None:
    path = tmp_path / "x.POMDP"
    with pytest.raises(PomdpFileError) as raised:
        read(path, content)
    assert str(raised.value).startswith(f"{path}: " if line is None else f"{path}, line {line}: ")
    assert re.search(message, str(raised.value)), str(raised.value)


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("bogus", "[1]", "unknown key 'bogus' after '#dpsearch:', known are state_names, action_names"),
        ("terminal", "[1, ", "#dpsearch: terminal must be followed by a list in JSON: "),
        ("terminal", "[" * 100_000, "must be followed by a list in JSON: "),
        ("terminal", "{}", "must be followed by a list in JSON$"),
        ("terminal", "[3]", "terminal must list whole numbers from 0 to 2"),
        ("terminal", "[-1]", "must list whole numbers from 0 to 2"),
        ("terminal", "[0.5]", "must list whole numbers from 0 to 2"),
        ("terminal", "[1e300]", "must list whole numbers from 0 to 2"),
        ("terminal", '["a"]', "terminal must list numbers"),
        ("terminal", "[[1], 2]", "must list numbers, in rows of the same length"),
        ("terminal", "[NaN]", "must list finite numbers"),
        ("terminal", "[" + "9" * 400 + "]", "must list "),
        ("state_names", '["a"]', "state_names must list 3 names"),
        ("state_names", '["a", "b", 1]', "state_names must list 3 names"),
        ("features", "[[1, 2]]", "features must list 2 rows of numbers"),
        ("features", "[1, 2]", "features must list 2 rows of numbers"),
        ("features", "[[], []]", "features must list 2 rows of numbers"),
        ("features", "[[1e999], [1]]", "must list finite numbers"),
        ("start", "[0, 1]", r"start must list pairs \[state, probability\]"),
        ("start", "[[0, 1.0]]", "start contradicts start:"),
        ("start", "[[3, 1.0]]", "start must number what has a probability from 0 to 2"),
        ("start", "[[0, 0.5], [1, 0.5], [2, 0]]", "start must list probabilities above 0"),
        ("transitions", "[1]", r"transitions must list \[state, action, "),
        ("transitions", "[[0, 0, [1, 2]]]", r"transitions must list \[state, action, "),
        ("transitions", "[[[0], 0, [[0, 1, 0]]]]", "transitions must list numbers, in rows"),
        ("transitions", "[[0, 2, [[0, 1, 0]]]]", "names a state or action that does not exist"),
        ("transitions", "[[0, 1, [[0, 1, 0]]], [0, 1, [[0, 1, 0]]]]", "names a state and action twice"),
        ("transitions", "[[0, 0, [[0, 1, 0]]]]", "transitions contradicts T for state 0, action 0"),
        ("transitions", "[[0, 0, [[0, 0.5, 0], [1, 0.5, 1]]]]", "transitions contradicts R for state 0, action 0"),
        ("transitions", "[[0, 0, [[0, 0.6, 0], [1, 0.4, 2]]]]", "transitions contradicts T for state 0, action 0"),
        ("observation_pool", "[]", "observation_pool must list rows of pairs"),
        ("observation_pool", "[[1, 1]]", "observation_pool must list rows of pairs"),
        ("observation_pool", "[[[2, 1]]]", "observation_pool must number what has a probability from 0 to 1"),
        ("observation_row", "[1, 1]", "observation_row must list 3 numbers, or as many rows of 2"),
        ("observation_row", "[1, 1, 2]", "observation_row must list whole numbers from 0 to 1"),
        ("observation_row", "[1, 0, 1]", "observation_row contradicts O for state 1, action 0"),
        ("first_observation_row", "[0]", "first_observation_row must list 3 numbers"),
        ("first_observation_row", "", "observation_pool must come with first_observation_row"),
    ],
)
def test_a_wrong_comment_is_named_with_its_line(tmp_path: Path, key: str, value: str, message: str) -> None:
    content = text(**{key: value})
    said = re.search(r"observation_pool must come", message)
    line = content[: content.index(f"#dpsearch: {'observation_pool' if said else key} ")].count("\n") + 1
    refused(tmp_path, content, line, message)


def test_comments_that_contradict_one_another_are_refused(tmp_path: Path) -> None:
    refused(tmp_path, text(terminal="[1]"), None, "an episode cannot start in a terminal state")
    pool = "[[[1, 0.5]], [[1, 0.5], [0, 0.5]]]"
    refused(tmp_path, text(observation_pool=pool), None, "the probabilities sum to 0.5, not 1")


def test_states_of_a_model_that_needs_more_of_them_are_not_numbered(tmp_path: Path) -> None:
    content = text() + "R : go : a : a : x 1"
    refused(tmp_path, content, 12, "transitions cannot be used where rewards depend on the observation")
    no_pool = dict.fromkeys(("observation_pool", "observation_row", "first_observation_row"), "")
    content = text(transitions="", features="[[1, 2], [3, 4], [5, 6]]", **no_pool) + "R : go : a : a : x 1"
    model = read(tmp_path / "x.POMDP", content)
    assert model.state_names == ("one", "two words", "three", "one/x", "one/why")
    np.testing.assert_array_equal(model.terminal, [False, False, True, False, False])
    np.testing.assert_array_equal(model.features, [[1, 2], [3, 4], [5, 6]])
