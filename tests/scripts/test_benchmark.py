import json
from pathlib import Path

import pytest

from scripts import benchmark
from scripts.benchmarks import speed


def test_the_update_is_compared_with_the_bare_lstm(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(speed, "UPDATES", 1)
    benchmark.main(["update", "--repeats", "1", "--out", str(tmp_path)])
    content = json.loads((tmp_path / "benchmark.json").read_text())
    ratios = [row for row in content["rows"] if row["at_most"] == 1.5]
    assert len(ratios) == 4
    assert all(row["median"] > 0.0 for row in ratios)
    assert content["command"].startswith("python scripts/benchmark.py update")
    assert "RPG update / bare nn.LSTM" in (tmp_path / "benchmark.md").read_text()


def test_an_unknown_benchmark_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        benchmark.main(["memories"])
    assert "unknown benchmark 'memories'" in capsys.readouterr().err
