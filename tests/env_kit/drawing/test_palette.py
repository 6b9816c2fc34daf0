from dpsearch.env_kit.drawing import palette


def test_colors_are_mixed() -> None:
    assert palette.mix("#000000", "#ffffff", 0.0) == "#000000"
    assert palette.mix("#000000", "#ff8000", 1.0) == "#ff8000"
    assert palette.mix("#102030", "#203040", 0.5) == "#182838"
