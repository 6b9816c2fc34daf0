import pytest

from scripts.benchmarks import simulator
from tests.support.torcs_wanted import require_torcs


def test_torcs_is_measured_where_it_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    require_torcs()
    monkeypatch.setattr(simulator, "STEPS", 10)
    (row,) = simulator.torcs(2)
    assert row.repeats == 2
    assert row.median > 0.0
