import numpy as np
import pytest

from dpsearch.report.statistics import Statistic, bootstrap_interval, success_interval


@pytest.mark.parametrize("statistic", ["mean", "median"])
def test_a_bootstrap_interval_holds_the_true_value_nearly_always(statistic: Statistic) -> None:
    rng = np.random.default_rng(0)
    intervals = [bootstrap_interval(rng.normal(3.0, 1.0, 40).tolist(), statistic) for _ in range(60)]
    held = sum(interval is not None and interval[0] <= 3.0 <= interval[1] for interval in intervals)
    assert 51 <= held <= 60


def test_a_bootstrap_interval_is_the_same_every_time() -> None:
    assert bootstrap_interval([1.0, 2.0, 4.0], "mean") == bootstrap_interval([1.0, 2.0, 4.0], "mean")


def test_one_value_has_no_interval_and_equal_ones_an_empty_one() -> None:
    assert bootstrap_interval([], "mean") is None
    assert bootstrap_interval([1.0], "mean") is None
    assert bootstrap_interval([2.0, 2.0, 2.0], "median") == (2.0, 2.0)


def test_success_intervals_are_wilsons() -> None:
    z = 1.959963984540054
    centre, half = 0.78 + z**2 / 200, z * np.sqrt(0.78 * 0.22 / 100 + z**2 / 40_000)
    expected = np.array([centre - half, centre + half]) / (1 + z**2 / 100)
    np.testing.assert_allclose(success_interval(78, 100), expected, rtol=1e-12)
    assert success_interval(20, 20)[1] == 1.0
    assert success_interval(0, 20)[0] == 0.0
