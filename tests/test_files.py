import dataclasses
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dpsearch.files import (
    CheckpointError,
    atomic_write,
    other_versions,
    plain,
    read_checkpoint,
    versions,
    write_checkpoint,
)

CONTENT = {"algo": "rpg", "numbers": [1, 2.5, None, True], "state": {"weights": torch.arange(300.0), 0: (1, "a")}}


def same(one: Any, other: Any) -> bool:
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(same(one[key], other[key]) for key in one)
    return torch.equal(one, other) if isinstance(one, torch.Tensor) else bool(one == other)


@pytest.mark.parametrize("content", ["text, ü\n", b"\x00bytes"])
def test_a_file_is_written_whole_and_nothing_is_left_beside_it(tmp_path: Path, content: str | bytes) -> None:
    (tmp_path / "file").write_text("before")
    atomic_write(tmp_path / "file", content)
    assert (tmp_path / "file").read_bytes() == (content.encode() if isinstance(content, str) else content)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_a_write_that_fails_leaves_the_old_file_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    def fail(*_: object) -> None:
        raise OSError(28, "No space left on device")

    (tmp_path / "file").write_text("before")
    monkeypatch.setattr(os, step, fail)
    with pytest.raises(OSError, match="No space left"):
        atomic_write(tmp_path / "file", "after")
    assert (tmp_path / "file").read_text() == "before"
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_checkpoint_is_read_as_it_was_written(tmp_path: Path) -> None:
    write_checkpoint(tmp_path / "folder" / "that is new" / "x.pt", CONTENT)
    read = read_checkpoint(tmp_path / "folder" / "that is new" / "x.pt")
    assert read.pop("versions") == versions()
    read.pop("format")
    assert same(read, CONTENT)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, bytes, dict[str, Any]]:
    path = tmp_path_factory.mktemp("damage") / "x.pt"
    write_checkpoint(path, CONTENT)
    return path, path.read_bytes(), read_checkpoint(path)


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_flipped_bit_is_noticed_or_changes_nothing(
    written: tuple[Path, bytes, dict[str, Any]], data: st.DataObject
) -> None:
    path, whole, content = written
    bit = data.draw(st.integers(0, 8 * len(whole) - 1))
    damaged = bytearray(whole)
    damaged[bit // 8] ^= 1 << bit % 8
    path.write_bytes(damaged)
    try:
        assert same(read_checkpoint(path), content)
    except CheckpointError as error:
        assert "damaged, truncated or not a checkpoint" in str(error) or "of format" in str(error)  # noqa: PT017


def test_a_flipped_bit_in_a_weight_is_noticed(written: tuple[Path, bytes, dict[str, Any]]) -> None:
    path, whole, _ = written
    place = whole.index(torch.arange(300.0).numpy().tobytes())
    path.write_bytes(whole[: place + 401] + bytes([whole[place + 401] ^ 1]) + whole[place + 402 :])
    with pytest.raises(CheckpointError, match="is damaged"):
        read_checkpoint(path)


def make_unreadable(path: Path) -> None:
    os.symlink(path, path)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: None, "no checkpoint at .*No such file"),
        (lambda path: path.mkdir(), "no checkpoint at .*directory"),
        (make_unreadable, "cannot read .*symbolic links"),
        (lambda path: path.touch(), "is damaged, truncated or not a checkpoint"),
        (lambda path: torch.save({"format": "x"}, path), "not a dpsearch checkpoint of format"),
        (lambda path: torch.save(CONTENT, path, _use_new_zipfile_serialization=False), "not a checkpoint"),
    ],
)
def test_what_is_wrong_with_a_file_is_named(tmp_path: Path, make: Callable[[Path], None], message: str) -> None:
    make(tmp_path / "x.pt")
    with pytest.raises(CheckpointError, match=message):
        read_checkpoint(tmp_path / "x.pt")


@pytest.mark.parametrize("foreign", [print, np.float64(1.0), {1, 2}, [np.arange(3)], {"deep": {"er": object()}}])
def test_what_could_not_be_read_again_is_not_written(tmp_path: Path, foreign: object) -> None:
    write_checkpoint(tmp_path / "x.pt", CONTENT)
    with pytest.raises(CheckpointError, match=r"^x\.pt: state: .*is of type '\w+', which a checkpoint cannot hold"):
        write_checkpoint(tmp_path / "x.pt", {"state": {"entry": foreign}})
    assert read_checkpoint(tmp_path / "x.pt")["algo"] == "rpg"


def test_other_versions_are_told() -> None:
    assert other_versions({"versions": versions()}) == ""
    assert other_versions({"versions": {**versions(), "torch": "1.0", "python": "2.7"}}).startswith("torch 1.0 (here ")


@dataclasses.dataclass
class Settings:
    size: Any = 1
    options: Any = None


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (np.int64(3), 3),
        (np.float32(0.5), 0.5),
        (np.bool_(True), True),
        (np.str_("a"), "a"),
        (np.eye(2), [[1.0, 0.0], [0.0, 1.0]]),
        (Path("a") / "b", str(Path("a") / "b")),
        ((1, [np.int8(2)]), (1, [2])),
        ({"a": {np.int64(1): np.float64(2)}}, {"a": {1: 2.0}}),
        (Settings(np.int64(2), {"x": np.float64(1)}), Settings(2, {"x": 1.0})),
    ],
)
def test_numbers_of_numpy_become_plain_ones(value: object, expected: object) -> None:
    converted = plain(value, "setting")
    assert converted == expected
    assert type(converted) is type(expected)
    assert repr(converted) == repr(expected)


@pytest.mark.parametrize("value", [print, {1}, [object()], {"a": lambda: 0}, torch.zeros(1), Settings])
def test_what_a_checkpoint_cannot_hold_is_refused_as_a_setting(value: object) -> None:
    with pytest.raises(ValueError, match=r"^setting(\[0\]|\.a)? must be made of numbers"):
        plain(value, "setting")
