import numpy as np
import pytest

from scripts.benchmarks import speed


def test_straight_walks_are_as_long_as_the_corridor_and_stay_so() -> None:
    algorithm = speed.walker(10, 20, straight=True)
    before = algorithm.policy.vector()
    for _ in range(3):
        expected = speed.next_batch(algorithm)
        start = algorithm.env_steps
        metrics = algorithm.update()
        assert algorithm.env_steps - start == expected.steps
        assert metrics["episode_length"] == pytest.approx(11, abs=0.5)
    np.testing.assert_allclose(algorithm.policy.vector(), before, atol=1e-9)


def test_sampling_is_measured_in_steps_a_core_second(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "SAMPLE_SECONDS", 1e-6)
    rows = speed.sampling(1)
    assert len(rows) == 12
    assert all(row.median > 0.0 for row in rows)


def test_driving_is_measured_with_batches_of_all_sizes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "SAMPLE_SECONDS", 1e-6)
    monkeypatch.setattr(speed, "DRIVE", 20)
    rows = speed.driving(1)
    assert [row.what for row in rows] == [f"track, batch {batch}, up to 20 steps" for batch in (20, 100, 1000)]
    assert all(row.median > 0.0 for row in rows)
