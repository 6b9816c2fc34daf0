from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from dpsearch.pomdp import PomdpFileError
from dpsearch.pomdp.file_format.reader import read_discount, read_pomdp_file
from dpsearch.pomdp.task import tabular_task
from tests.support.pomdp_texts import FILES, HEAD, MOVES, SEEN


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "x.POMDP"


def refused(path: Path, text: str | bytes, line: int | None, message: str) -> None:
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(PomdpFileError) as raised:
        read_pomdp_file(path)
    where = f"{path}: " if line is None else f"{path}, line {line}: "
    assert str(raised.value).startswith(where)
    assert re.search(message, str(raised.value)), str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("body", "line", "message"),
    [
        # names and numbers
        ("T : go : d : a 1", 6, "unknown state 'd': the states are a, b, c, or numbers from 0 to 2"),
        ("\n\nT : go : a : e 1", 8, "unknown state 'e'"),
        ("T : walk identity", 6, "unknown action 'walk': the actions are go, stay, or numbers from 0 to 1"),
        ("O : go : a : z 1", 6, "unknown observation 'z'"),
        ("T : go : 3 : a 1", 6, "state 3 is out of range: the states are a, b, c, or numbers from 0 to 2"),
        ("T : -1 identity", 6, "unknown action '-1'"),
        ("R : go : a : b : 2 1", 6, "observation 2 is out of range"),
        ("start: d", 6, "unknown state 'd'"),
        ("start: 3", 6, "state 3 is out of range"),
        ("start include: a\n q", 7, "unknown state 'q'"),
        ("start include: *", 6, r"start include takes states, not '\*'"),
        ("start: *", 6, "start must be a state, uniform, or the probabilities of all 3 states, got 1 word"),
        # probabilities
        ("T : go : a : a\n1.5", 7, "a probability must be from 0 to 1, got 1.5"),
        ("T : go 1 0 0 0\n1 0\n1 -0.5 .5", 8, "a probability must be from 0 to 1, got -0.5"),
        ("O : go : a .5 nan", 6, "expected a number, got 'nan'"),
        ("T : go : a : b inf", 6, "expected a number, got 'inf'"),
        ("T : go : a : b 1e999", 6, "expected a number, got '1e999'"),
        ("T : go : a : b 1_0", 6, "expected a number, got '1_0'"),
        ("T : go : a : b \u0661", 6, "expected a number, got '\u0661'"),
        ("R : go : a : b : * --1", 6, "expected a number, got '--1'"),
        ("T : go : a : b x", 6, "expected a number, got 'x'"),
        (MOVES + SEEN + "T : go : a : b 0.5\n\n", 8, "T for action go, state a: the probabilities sum to 1.5, not 1"),
        (
            MOVES + SEEN + "T : go : a : a\n0.5\nT : stay : b : b 1",
            8,
            "T for action go, state a: the probabilities sum to 0.5",
        ),
        (MOVES + SEEN + "T : * : c 0 0 0", 8, "T for action go, state c: the probabilities sum to 0, not 1"),
        (MOVES + SEEN + "O : stay : b : x 0.75", 8, "O for action stay, next state b: the probabilities sum to 1.25"),
        (MOVES, None, "O for action go, next state a: no probabilities are given"),
        (MOVES + "O : go uniform", None, "O for action stay, next state a: no probabilities are given"),
        (SEEN + "T : go identity", None, "T for action stay, state a: no probabilities are given"),
        ("start: 0.5 0.5 0.5", 6, "the probabilities of the start states sum to 1.5, not 1"),
        ("start: 1.5 0 -0.5", 6, "a probability must be from 0 to 1, got 1.5"),
        ("start: a b", 6, "got 2 words; several states are listed after 'start include:'"),
        ("start: a b c", 6, "got 3 words; several states are listed after 'start include:'"),
        ("start: 0.5 0.5", 6, "start must be a state, uniform, or the probabilities of all 3 states, got 2 words"),
        ("start include:", 6, "expected ':' and states after start include"),
        ("start exclude a", 6, "expected ':' and states after start exclude"),
        ("start exclude: a b c", 6, "start exclude leaves no state to start in"),
        ("start: a start: b", 6, "start is given a second time, after line 6"),
        ("start include: a\nstart: b", 7, "start is given a second time, after line 6"),
        # shapes
        ("T : go : a 1 0", 6, "expected 3 numbers for 'T : action : state row', got 2"),
        ("T : go 1 0 0\n0 1 0\n0 0", 6, "expected 9 numbers for 'T : action matrix', got 8"),
        ("T : go : a 1 0\n0 0", 7, "expected 3 numbers for 'T : action : state row', got 4"),
        ("O : go : a : x 1 0", 6, "expected 1 number for 'O : action : next state : observation number', got 2"),
        ("O : go : a : x", 6, "expected 1 number for .* got 0"),
        ("R : go : a : b 1", 6, "expected 2 numbers for 'R : action : state : next state row', got 1"),
        ("R : go : a 1 2 3", 6, "expected 6 numbers for 'R : action : state matrix', got 3"),
        ("R : go 1 2 3", 6, "expected R : action : state : next state : observation number, or"),
        ("R : go : a : b uniform", 6, "expected 2 numbers for 'R : action : state : next state row', got 1"),
        ("T : go : a : b : c 1", 6, "too many ':': expected T : action : state : next state number, or"),
        ("T : go : a :", 6, "nothing follows the last ':' of this T"),
        ("T :", 6, "nothing follows the last ':' of this T"),
        ("T go identity", 6, "expected ':' after T, which is a keyword and cannot be a name"),
        ("T", 6, "expected ':' after T"),
        ("T : : go", 6, "unknown action ':'"),
        ("O : go reset", 6, "reset is a distribution of states: it may follow T, not O"),
        ("O : go identity", 6, "identity is a matrix, with as many columns as there are states"),
        ("T : go : a identity", 6, "identity is a matrix"),
        ("T : go : a : b uniform", 6, "expected a number, got 'uniform'"),
        # what is too large
        ("R : go : a : b : * 1e400", 6, "expected a number, got '1e400'"),
    ],
)
def test_a_wrong_statement_is_named_with_its_line(path: Path, body: str, line: int | None, message: str) -> None:
    refused(path, HEAD + body, line, message)


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("discount: 0.9\n", "", None, "discount: is missing: a file must give discount, values, states, actions, obs"),
        ("values: reward\n", "", None, "values: is missing"),
        ("states: a b c\n", "", None, "states: is missing"),
        ("actions: go stay\n", "", None, "actions: is missing"),
        ("observations: x y\n", "", None, "observations: is missing"),
        ("0.9", "1.5", 1, "discount must be from 0 to 1, got 1.5"),
        ("0.9", "-0.1", 1, "discount must be from 0 to 1, got -0.1"),
        ("0.9", "high", 1, "expected a number, got 'high'"),
        ("0.9", "0.9 0.8", 1, "expected only a number from 0 to 1, got '0.8' too"),
        ("0.9", "", 1, "nothing follows discount:"),
        ("reward", "money", 2, "values must be reward or cost, got 'money'"),
        ("reward", "reward cost", 2, "expected only reward or cost, got 'cost' too"),
        ("states: a", "states a", 3, "expected ':' after states, which is a keyword and cannot be a name"),
        ("a b c", "a b a", 3, "two states are called a, the other one in line 3"),
        ("a b c", "", 3, "nothing follows states:"),
        ("a b c", "a T c", 3, "expected ':' after T, which is a keyword and cannot be a name"),
        ("a b c", "a uniform c", 3, "'uniform' cannot be one of the names of states: expected names"),
        ("go stay", "2 stay", 4, "'2' cannot be one of the names of actions"),
        ("x y", "x 0.5", 5, "'0.5' cannot be one of the names of observations"),
        ("x y", "2.0", 5, "'2.0' cannot be one of the names"),
        ("x y", "0", 5, "there must be at least one observation"),
        ("x y", "-2", 5, "'-2' cannot be one of the names"),
        ("go stay", "go stay\nactions: a b", 5, "actions is given a second time, after line 4"),
        ("a b c", "1000000000", 3, "1,000,000,000 states times 2 actions are too many: the limit is 2,000,000"),
        ("a b c", "9" * 5000, 3, "states times 2 actions are too many"),
        ("x y", "100001", 5, "100,001 observations are too many: the limit is 100,000"),
        ("x y", "99999", None, "99,999 observations would be as many inputs: the limit is 4,096"),
        ("a b c", "5000", None, "T would hold 25,009,999 probabilities: the limit is 10,000,000"),
        ("discount", "hello", 1, "expected one of discount, values, .*, got 'hello'"),
    ],
)
def test_a_wrong_preamble_is_named_with_its_line(
    path: Path, old: str, new: str, line: int | None, message: str
) -> None:
    text = HEAD + MOVES + SEEN
    assert text.count(old) == 1 or old in ("discount", "reward")
    if new == "5000":
        text += "T : go uniform T : stay identity T : stay : 3 uniform"
    refused(path, text.replace(old, new, 1), line, message)


@pytest.mark.parametrize("keyword", ["R", "T", "O", "start", "values"])
@pytest.mark.parametrize("place", ["{} L U", "L {} U", "L U {}"])
def test_a_keyword_among_names_is_told_from_a_statement(path: Path, keyword: str, place: str) -> None:
    text = (HEAD + MOVES + SEEN).replace("actions: go stay", f"actions: {place.format(keyword)}")
    refused(path, text, 4, f"expected ':' after {keyword}, which is a keyword and cannot be a name")


@pytest.mark.parametrize("encoding", ["latin-1", "cp1252", "utf-16-le"])
def test_comments_may_be_in_any_encoding(path: Path, encoding: str) -> None:
    comment = b"# " + "caf\u00e9".encode(encoding) + b"\n"
    path.write_bytes(comment + (HEAD + MOVES + SEEN).encode() + comment)
    assert read_pomdp_file(path).n_actions == 2


def test_what_is_no_text_is_refused(path: Path) -> None:
    refused(path, b"", None, "the file is empty: it must give discount, values, states, actions, observations")
    refused(path, b"# only a comment\n", None, "the file is empty")
    refused(path, HEAD.encode() + b"T : \xff\xfe", 6, "this is not text in UTF-8")
    refused(path, HEAD.encode() + b"T : caf\xe9 # caf\xe9", 6, "this is not text in UTF-8")
    refused(path, b"\x89PNG\r\n\x1a\n\x00\x00", 1, "this is not text in UTF-8")
    refused(path, b"\x00\x01\x02", 1, "expected one of discount")


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    for path, message in ((tmp_path / "none.POMDP", "there is no such file"), (tmp_path, "is not a file")):
        with pytest.raises(PomdpFileError, match=re.escape(f"{path}: {message}")):
            read_pomdp_file(path)
    with pytest.raises(PomdpFileError, match="/dev/zero: is not a file"):
        read_pomdp_file("/dev/zero")


def test_rewards_for_observations_have_a_limit(path: Path) -> None:
    head = "discount: 1 values: reward actions: 1 start: 0 O : * uniform R : * : * : * : 7 1\n"
    many, few = "states: 1500 observations: 1500\n", "states: 30 observations: 1000\n"
    refused(path, head + many + "T : * identity", None, "2,250,000 pairs .* takes as many more states, the limit is 2,")
    refused(path, head + many + "T : * uniform", None, "depend on the observation in 3,375,000,000 cases")
    refused(path, head + few + "T : * uniform", None, "30,000 pairs .* takes 900,000,000 more transitions")


def test_the_discount_can_be_read_alone(path: Path) -> None:
    path.write_text("states: 10 discount: 0.75 T : nonsense")
    assert read_discount(path) == 0.75
    path.write_text("states: 10")
    with pytest.raises(PomdpFileError, match="discount: is missing"):
        read_discount(path)


# Fuzz

WORDS = [
    *("T", "O", "R", "start", "include", "exclude", "uniform", "identity", "reset", ":", "*", "#"),
    *("states", "actions", "observations", "discount", "values", "reward", "cost", "hear-left", "good", "x"),
    *("0", "1", "2", "3", "7", "-1", "0.5", "1.0", "1e-3", "1e308", "-1e308", "nan", "inf"),
    *("1000000000", "99999", "4000", "\x00", "é", "\u2028"),
    *("#dpsearch:", "features", "terminal", "[", "]", "[[0,1]]", "{}"),
]
COMMENTED = """\
#dpsearch: state_names ["a 1", "b", "c"]
#dpsearch: features [[1, 2], [3, 4]]
#dpsearch: terminal [2]
#dpsearch: start [[1, 0.5], [0, 0.5]]
#dpsearch: transitions [[0, 0, [[1, 0.25, 1], [0, 0.5, 0], [1, 0.25, 3]]]]
#dpsearch: observation_pool [[[0, 0.5], [1, 0.5]], [[1, 1.0]]]
#dpsearch: observation_row [0, 0, 0]
#dpsearch: first_observation_row [1, 1, 1]
start: 0.5 0.5 0
T : go : a : a 0.5
T : go : a : b 0.5
R : go : a : b : * 2
"""


def valid_texts() -> list[bytes]:
    inline = HEAD + MOVES + SEEN + COMMENTED
    return [(FILES / f"{name}.POMDP").read_bytes() for name in ("tiger", "every_form")] + [inline.encode()]


def mutant(random: np.random.Generator, text: bytes) -> bytes:
    """A text with some words or bytes deleted, doubled, exchanged or replaced."""
    for _ in range(int(random.integers(1, 4))):
        if random.random() < 0.7:
            parts: list[bytes] = re.split(rb"(\s+|:)", text)
            i, j = random.integers(len(parts), size=2)
            match random.integers(5):
                case 0:
                    del parts[i]
                case 1:
                    parts[i] += b" " + parts[i]
                case 2:
                    parts[i], parts[j] = parts[j], parts[i]
                case 3:
                    parts[i] = random.choice(WORDS).encode()
                case _:
                    parts[i:] = parts[j:] if random.random() < 0.5 else []
            text = b"".join(parts)
        elif text:
            data = bytearray(text)
            i = int(random.integers(len(data)))
            match random.integers(3):
                case 0:
                    del data[i]
                case 1:
                    data[i] = int(random.integers(256))
                case _:
                    data.insert(i, int(random.integers(32, 127)))
            text = bytes(data)
    return text


@pytest.mark.parametrize("block", range(4))
def test_a_malformed_file_gives_one_clear_error_and_nothing_else(path: Path, block: int) -> None:
    random = np.random.default_rng(block)
    texts, outcomes = valid_texts(), {True: 0, False: 0}
    for number in range(1000):
        path.write_bytes(mutant(random, texts[number % len(texts)]))
        try:
            tabular_task(read_pomdp_file(path), 10)
            message = None
        except PomdpFileError as error:
            message = str(error)
        outcomes[message is None] += 1
        assert message is None or (message.startswith(str(path)) and "\n" not in message)
    assert min(outcomes.values()) > 50
