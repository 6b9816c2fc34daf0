"""Checkpoints are written whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
import torch

from dpsearch.files import CheckpointError, read_checkpoint, write_checkpoint

CONTENT = {"algo": "rpg", "weights": torch.arange(3.0)}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "checkpoint.pt"


def test_a_checkpoint_comes_back_with_the_versions_that_wrote_it(path: Path) -> None:
    write_checkpoint(path, CONTENT)
    found = read_checkpoint(path)
    assert found["algo"] == "rpg"
    assert found["weights"].tolist() == [0.0, 1.0, 2.0]
    assert found["versions"].keys() >= {"dpsearch", "python", "torch"}


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_a_write_that_is_cut_short_leaves_the_old_checkpoint(
    path: Path, step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError("no space left on device")

    write_checkpoint(path, CONTENT)
    monkeypatch.setattr(os, step, full)
    with pytest.raises(OSError, match="no space"):
        write_checkpoint(path, {"algo": "nes"})
    assert read_checkpoint(path)["algo"] == "rpg"


def test_a_checkpoint_replaces_the_last_one_and_leaves_nothing_beside_it(path: Path) -> None:
    for algo in ("rpg", "nes"):
        write_checkpoint(path, {"algo": algo})
    assert read_checkpoint(path)["algo"] == "nes"
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("kept", [0, 10, 500])
def test_a_truncated_checkpoint_is_refused(path: Path, kept: int) -> None:
    write_checkpoint(path, CONTENT)
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(CheckpointError, match=r"checkpoint\.pt is truncated"):
        read_checkpoint(path)


@pytest.mark.parametrize("content", [{"algo": "rpg"}, {"format": -1}, [1, 2]])
def test_a_file_of_another_format_is_refused(path: Path, content: object) -> None:
    torch.save(content, path)
    with pytest.raises(CheckpointError, match="not a dpsearch checkpoint of format"):
        read_checkpoint(path)


def test_a_checkpoint_that_is_missing_is_named(path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"no checkpoint at .*checkpoint\.pt"):
        read_checkpoint(path)


def test_content_that_could_not_be_read_again_is_not_written(path: Path) -> None:
    with pytest.raises(CheckpointError, match=r"checkpoint\.pt would not be readable"):
        write_checkpoint(path, {"algo": lambda: None})
    assert not path.exists()
