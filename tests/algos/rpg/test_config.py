"""The settings of RPG: what is out of range is named."""

from __future__ import annotations

import math
from typing import Any

import pytest

from dpsearch.algos import RPG, RPGConfig


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("batch_size", 0),
        ("batch_size", 2.5),
        ("batch_steps", 0),
        ("gamma", 1.5),
        ("learning_rate", -1.0),
        ("learning_rate", float("inf")),
        ("learning_rate_halflife", -1.0),
        ("optimizer", "Sgd"),
        ("optimizer", "LBFGS"),
        ("gradient_length", 0.0),
        ("gradient_length", math.inf),
        ("trace", 1.1),
        ("advantage_memory", 0.0),
        ("entropy_bonus", -0.1),
        ("entropy_halflife", 0.0),
        ("restart_episodes", 0),
        ("restart_gain", -1.0),
        ("restart_gain", math.inf),
        ("natural_step", -1.0),
        ("damping", -1.0),
        ("update_steps", 0),
        ("mirror", None),
    ],
)
def test_a_setting_out_of_range_is_named(setting: str, value: Any) -> None:
    with pytest.raises(ValueError, match=f"^{setting} must be .*, got "):
        RPGConfig(**{setting: value})


def test_a_setting_that_was_renamed_is_refused_with_its_new_name() -> None:
    with pytest.raises(TypeError, match=r"^algo\.baseline_cells is now algo\.baseline\.cells$"):
        RPG("dpsearch/TMaze-v0", baseline_cells=20)
