from scripts.benchmarks.measurement import Measurement


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
