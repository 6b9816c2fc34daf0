"""Baselines: the return to expect at each step, to which the return received is compared (section 3.3.2).

Each is one file: its settings, and the class that predicts and learns. A new one is entered in ``BASELINES``.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from typing import Any

from dpsearch.algos.baselines.base import Baseline, BaselineConfig
from dpsearch.algos.baselines.constant import ConstantBaseline
from dpsearch.algos.baselines.history import HistoryBaseline
from dpsearch.algos.baselines.quadratic import QuadraticBaseline
from dpsearch.algos.baselines.shared import SharedBaseline
from dpsearch.policies import RecurrentPolicy

BASELINES: dict[str, type[Baseline]] = {
    baseline.config_type().kind: baseline
    for baseline in (ConstantBaseline, SharedBaseline, HistoryBaseline, QuadraticBaseline)
}
"""Baselines by kind, the name that configurations and checkpoints use."""
DEFAULTS: dict[str, BaselineConfig] = {kind: baseline.config_type() for kind, baseline in BASELINES.items()}
"""Default settings by kind, as RPG has them."""


def baseline_config(given: Any, kinds: Mapping[str, BaselineConfig]) -> BaselineConfig:
    """The settings of a baseline from any form in which users give them.

    Args:
        given: A kind, ``"history"``; a kind with settings, ``{"kind": "history", "cells": 32}``; or ready settings.
        kinds: The baselines to choose from, with their default settings.

    Raises:
        ValueError: If there is no such baseline, or it does not take the settings.
    """
    if isinstance(given, BaselineConfig):
        given = {f.name: getattr(given, f.name) for f in fields(given)}
    settings = dict(given) if isinstance(given, Mapping) else {"kind": given}
    kind = settings.pop("kind", None)
    if not isinstance(kind, str) or kind not in kinds:
        raise ValueError(f"baseline.kind must be one of {', '.join(kinds)}, got {kind!r}")
    accepted = settings_of(kinds[kind])
    for name in settings:
        if name not in accepted:
            raise ValueError(
                f"baseline.{name} is no setting of the {kind} baseline, which takes {', '.join(accepted) or 'none'}"
            )
    try:
        return replace(kinds[kind], **settings)
    except ValueError as error:
        raise ValueError(f"baseline.{error}") from error


def make_baseline(config: BaselineConfig, policy: RecurrentPolicy, seed: int) -> Baseline:
    """A new baseline.

    Args:
        config: The settings.
        policy: The policy whose returns are to be expected.
        seed: Seed of the initial weights, if the baseline has weights of its own.

    Raises:
        ValueError: If an optimiser does not take its options.
    """
    try:
        return BASELINES[config.kind](config, policy, seed)
    except ValueError as error:
        raise ValueError(f"baseline.{error}") from error


def settings_of(config: BaselineConfig) -> list[str]:
    """Names of a baseline's settings, its kind aside."""
    return [f.name for f in fields(config) if f.init]


def left_behind(settings: Mapping[str, Any], given: Iterable[str]) -> list[str]:
    """Settings of other kinds, which remain where one file says another kind than the file that it is merged with.

    Args:
        settings: The merged settings.
        given: Names of settings that the user gave, which are no remains.
    """
    kind = settings.get("kind")
    own = settings_of(DEFAULTS[kind]) if kind in DEFAULTS else []
    others = {name for config in DEFAULTS.values() for name in settings_of(config)} - {*own, *given}
    return [name for name in settings if name in others]
