import pytest

from scripts.benchmarks import searching


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
