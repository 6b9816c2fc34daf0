"""Baselines by kind: the forms in which users give them, and the settings that each takes."""

from __future__ import annotations

from typing import Any

import pytest

from dpsearch.algos import LRWRConfig, RPGConfig
from dpsearch.algos.baselines import BASELINES, DEFAULTS, left_behind, settings_of
from dpsearch.algos.baselines.history import HistoryConfig


@pytest.mark.parametrize("kind", BASELINES)
def test_the_short_form_has_the_defaults(kind: str) -> None:
    assert RPGConfig(baseline=kind).baseline == RPGConfig(baseline={"kind": kind}).baseline == DEFAULTS[kind]
    assert DEFAULTS[kind].kind == kind


def test_settings_come_as_a_mapping_or_ready() -> None:
    ready = HistoryConfig(cells=32)
    assert RPGConfig(baseline={"kind": "history", "cells": 32}).baseline == RPGConfig(baseline=ready).baseline == ready


def test_defaults_may_be_the_algorithm_s_own() -> None:
    assert RPGConfig(baseline="shared").baseline.weight == 0.1
    assert LRWRConfig(baseline="shared", discount_steps=False).baseline.weight == 0.03


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("mean", "baseline.kind must be one of constant, shared, history, quadratic, got 'mean'"),
        (None, "baseline.kind must be one of constant, shared, history, quadratic, got None"),
        ({"cells": 3}, "baseline.kind must be one of constant, shared, history, quadratic, got None"),
        ({"kind": ["history"]}, r"baseline.kind must be one of .*, got \['history'\]"),
        (
            {"kind": "constant", "cells": 3},
            "baseline.cells is no setting of the constant .*, which takes episodes$",
        ),
        ({"kind": "quadratic", "steps": 3}, "baseline.steps is no setting of the quadratic baseline, which takes none"),
        (
            {"kind": "history", "sells": 3},
            "baseline.sells is no setting of the history baseline, which takes cells",
        ),
    ],
)
def test_a_kind_or_setting_that_there_is_not_is_refused(given: Any, message: str) -> None:
    with pytest.raises(ValueError, match=f"^{message}"):
        RPGConfig(baseline=given)


def test_lrwr_has_some_kinds_only() -> None:
    with pytest.raises(ValueError, match=r"^baseline.kind must be one of none, shared, got 'history'"):
        LRWRConfig(baseline=HistoryConfig())


@pytest.mark.parametrize(
    ("kind", "setting", "value"),
    [
        ("constant", "episodes", -1),
        ("constant", "episodes", 2.5),
        ("shared", "weight", -0.1),
        ("shared", "weight", "much"),
        ("history", "cells", 0),
        ("history", "cells", True),
        ("history", "optimizer", "Sgd"),
        ("history", "learning_rate", 0.0),
        ("history", "learning_rate", float("inf")),
        ("history", "optimizer_options", 3),
        ("history", "steps", 0),
    ],
)
def test_a_setting_out_of_range_is_named(kind: str, setting: str, value: Any) -> None:
    with pytest.raises(ValueError, match=rf"^baseline\.{setting} must be .*, got "):
        RPGConfig(baseline={"kind": kind, setting: value})


@pytest.mark.parametrize("kind", BASELINES)
@pytest.mark.parametrize("other", BASELINES)
def test_settings_of_another_kind_are_remains_unless_the_user_gave_them(kind: str, other: str) -> None:
    merged = {"kind": kind, "bogus": 1, **dict.fromkeys(settings_of(DEFAULTS[other]), 1)}
    remains = [] if kind == other else settings_of(DEFAULTS[other])
    assert left_behind(merged, given=[]) == remains
    assert left_behind(merged, given=remains) == []
