from pathlib import Path

import pytest

from dpsearch.runs import RunError
from dpsearch.runs.metrics import MetricsFile

LINES = '{"update": 1}\n{"update": 2}\n{"update": 3}\n'


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "metrics.jsonl"
    path.write_text(LINES + '{"upda')
    return path


def test_a_new_file_begins_empty_and_takes_lines(tmp_path: Path) -> None:
    metrics = MetricsFile(tmp_path / "metrics.jsonl", 0)
    assert metrics.last == {}
    metrics.add({"update": 1, "return": 0.1})
    metrics.close()
    assert (tmp_path / "metrics.jsonl").read_text() == '{"update": 1, "return": 0.1}\n'


@pytest.mark.parametrize("updates", [0, 1, 3])
def test_lines_after_the_checkpoint_are_cut_off_and_new_ones_follow(path: Path, updates: int) -> None:
    metrics = MetricsFile(path, updates)
    assert metrics.last == ({"update": updates} if updates else {})
    metrics.add({"update": updates + 1})
    metrics.flush()
    expected = "".join(f'{{"update": {k + 1}}}\n' for k in range(updates + 1))
    assert path.read_text() == expected
    metrics.close()


def test_missing_lines_are_refused_and_nothing_is_cut_off(path: Path) -> None:
    before = path.read_text()
    with pytest.raises(RunError, match="ends at update 3, before the checkpoint's 4"):
        MetricsFile(path, 4)
    assert path.read_text() == before


def test_there_is_one_writer_at_a_time(path: Path) -> None:
    pytest.importorskip("fcntl")
    first = MetricsFile(path, 3)
    with pytest.raises(RunError, match="another process"):
        MetricsFile(path, 3)
    first.close()
    MetricsFile(path, 3).close()


def test_lines_reach_the_disk_when_they_are_asked_to(path: Path) -> None:
    metrics = MetricsFile(path, 3)
    metrics.add({"update": 4})
    assert path.read_text() == LINES  # buffered: an update must not wait for the disk
    metrics.sync()
    assert path.read_text() == LINES + '{"update": 4}\n'
    metrics.close()
