import numpy as np
import pytest

from dpsearch.env_kit.drawing.canvas import Canvas


def test_text_that_is_too_wide_is_broken_or_made_smaller() -> None:
    canvas = Canvas(400, 200)
    assert canvas.text_width("wide", 20) > canvas.text_width("wide", 10) > 0
    assert canvas.paragraph((0, 0), "one two three", 1000, 10) == pytest.approx(14)
    assert canvas.paragraph((0, 0), "one two three", 1, 10) == pytest.approx(42)
    canvas.text((10, 100), "as long as a line of text can be", 40, "#000000", width=150)
    columns = np.flatnonzero((canvas.frame()[80:] < 100).all(axis=(2,)).any(axis=0))
    assert columns.max() < 165
