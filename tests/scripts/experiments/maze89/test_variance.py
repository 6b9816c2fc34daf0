"""The variance of the gradient in the 89-state maze."""

from __future__ import annotations

import pytest

from scripts.experiments.maze89 import variance


def test_a_constant_baseline_takes_much_of_the_gradient_s_variance_away(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(variance, "BATCHES", 20)
    found = variance.measure(("experiment=maze89_thesis", "total_steps=200_000"), 0)
    assert 0.0 <= found["constant"] < 1.0
    assert found["history_by_constant"] == pytest.approx(found["history"] / found["constant"])
