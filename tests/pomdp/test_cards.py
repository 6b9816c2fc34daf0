from dpsearch.pomdp.cards import percent


def test_only_what_is_certain_is_called_0_or_100_percent() -> None:
    assert [percent(p) for p in (0.0, 0.001, 0.854, 0.999, 1 - 1e-12, 1.0)] == [
        "0%",
        "<1%",
        "85%",
        ">99%",
        "100%",
        "100%",
    ]
