import json
from pathlib import Path

import numpy as np
import pytest

from scripts import benchmark
from scripts.benchmarks import probes, processes, searching, simulator, speed
from scripts.benchmarks.measurement import Measurement
from tests.support.torcs_wanted import require_torcs


def measured(values: list[float], at_least: float | None = None, at_most: float | None = None) -> Measurement:
    return Measurement.of(values, benchmark="b", what="w", unit="s", at_least=at_least, at_most=at_most)


def test_a_measurement_has_a_median_and_quartiles() -> None:
    row = measured([1.0, 2.0, 3.0, 4.0, 9.0])
    assert (row.low, row.median, row.high, row.repeats) == (2.0, 3.0, 4.0, 5)


def test_a_promise_is_kept_or_missed() -> None:
    assert measured([1.0]).met is None
    assert measured([1.0], at_least=1.0).met
    assert measured([1.0], at_most=1.0).met
    assert not measured([0.9], at_least=1.0).met
    assert not measured([1.1], at_most=1.0).met


def test_straight_walks_are_as_long_as_the_corridor_and_stay_so() -> None:
    algorithm = speed._rpg(10, 20, straight=True)
    before = algorithm.policy.vector()
    for _ in range(3):
        expected = speed._next_batch(algorithm)
        start = algorithm.env_steps
        metrics = algorithm.update()
        assert algorithm.env_steps - start == expected.steps
        assert metrics["episode_length"] == pytest.approx(11, abs=0.5)
    np.testing.assert_allclose(algorithm.policy.vector(), before, atol=1e-9)


def test_the_update_is_compared_with_the_bare_lstm(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(speed, "UPDATES", 1)
    benchmark.main(["update", "--repeats", "1", "--out", str(tmp_path)])
    content = json.loads((tmp_path / "benchmark.json").read_text())
    ratios = [row for row in content["rows"] if row["at_most"] == 1.5]
    assert len(ratios) == 4
    assert all(row["median"] > 1.0 for row in ratios)
    assert content["command"].startswith("python scripts/benchmark.py update")
    assert "RPG update / bare nn.LSTM" in (tmp_path / "benchmark.md").read_text()


def test_sampling_is_measured_in_steps_a_core_second(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "SAMPLE_SECONDS", 1e-6)
    rows = speed.sampling(1)
    assert len(rows) == 12
    assert all(row.median > 0.0 for row in rows)


def test_torcs_is_measured_where_it_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    require_torcs()
    monkeypatch.setattr(simulator, "STEPS", 10)
    (row,) = simulator.torcs(2)
    assert row.repeats == 2
    assert row.median > 0.0


def test_driving_is_measured_with_batches_of_all_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "SAMPLE_SECONDS", 1e-6)
    monkeypatch.setattr(speed, "DRIVE", 20)
    rows = speed.driving(1)
    assert [row.what for row in rows] == [f"track, batch {batch}, up to 20 steps" for batch in (20, 100, 1000)]
    assert all(row.median > 0.0 for row in rows)


def test_a_probe_runs_in_a_process_of_its_own_and_says_how_much_memory_it_had() -> None:
    numbers = processes._probe("longest_corridor")
    assert numbers["peak"] > 20.0
    assert numbers["build"] > 0.0


def test_the_peak_of_memory_is_in_mebibytes() -> None:
    before = probes.peak_memory()
    block = np.ones(100 * 2**17)  # 100 MiB
    assert probes.peak_memory() >= before
    assert 100.0 < probes.peak_memory() < 100_000.0
    del block


def test_an_unknown_benchmark_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        benchmark.main(["memories"])
    assert "unknown benchmark 'memories'" in capsys.readouterr().err


def test_populations_are_measured_with_equal_and_with_unequal_lengths(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searching, "LONG", 300)
    rows = searching.population(1)
    assert [row.at_least for row in rows] == [15e6, 7.5e6, 7.5e6, 7.5e6]
    assert all(row.median > 0.0 for row in rows)


def test_searches_are_measured_beside_cma(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(searching, "WARM_UP", 2)
    monkeypatch.setattr(searching, "GENERATIONS", 2)
    rows = searching.search(1)
    assert len(rows) == 11
    assert rows[1].at_most == rows[0].median
    assert all(row.at_most == 10.0 for row in rows[7:])
