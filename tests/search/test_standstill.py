"""The rules that end a search which stands still, and what they leave alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dpsearch.search import FEM, NES, SNES, XNES, Restarts
from dpsearch.search.functions import FUNCTIONS
from dpsearch.search.standstill import Standstill
from tests.support.searches import SEARCHES, Array

RULES: dict[str, Any] = {"tolfun": 0.0, "stagnation": 30, "max_condition": 1e14}


def rastrigin(x: Array) -> float:
    return -float(FUNCTIONS["Rastrigin"](x)) - 100.0


def in_single_precision(x: Array) -> float:
    z = x.astype(np.float32)
    return -float(np.float32(120.0) + (z**2 - np.float32(10.0) * np.cos(np.float32(2.0 * np.pi) * z)).sum())


STUCK: dict[str, Callable[[Array], float]] = {
    "an optimum that is not 0": rastrigin,
    "fitness in single precision": in_single_precision,
    "rounded coordinates": lambda x: rastrigin(np.round(x, 2)),
    "steps": lambda x: float(np.floor(rastrigin(x))),
    "a plateau": lambda x: 7.0,
    "nothing valid": lambda x: np.nan,
    "an axis of no effect": lambda x: -(x[0] ** 2) - 3.0,
}


@pytest.mark.filterwarnings("ignore:NaN or infinite fitness")
@pytest.mark.parametrize("fitness", STUCK)
@pytest.mark.parametrize("search_type", [NES, XNES, SNES, FEM])
def test_restarts_move_on_from_wherever_a_search_is_stuck(search_type: Any, fitness: str) -> None:
    search = Restarts(search_type, [3.3, -2.1], 1.0, seed=4, max_evaluations=20_000)
    search.maximize(STUCK[fitness], callback=lambda restarts: restarts.runs < 3)
    assert search.runs == 3


@pytest.mark.parametrize("name", sorted(set(SEARCHES) - {"cmaes", "restarts"}))
def test_a_search_alone_does_not_end_on_a_plateau(name: str) -> None:
    search = SEARCHES[name](np.ones(2), 1.0, seed=0, max_evaluations=3000)
    assert not {"flat", "stagnation", "condition"} & set(search.maximize(lambda x: 7.0).stop)


@pytest.mark.parametrize("name", sorted(set(SEARCHES) - {"cmaes", "restarts"}))
def test_reasons_are_named_and_survive_a_state(name: str) -> None:
    search, heir = (SEARCHES[name](np.ones(2), 1.0, seed=0, **RULES) for _ in range(2))
    while not search.stop():
        search.tell(search.ask(), np.full(len(search.ask()), 7.0))
        heir.load_state_dict(search.state_dict())
        assert heir.stop() == search.stop()
        assert search.evaluations < 5000
    assert search.stop() == {"flat": search.evaluations}


@pytest.mark.parametrize("noise", [0.0, 1.0])
def test_slow_progress_is_no_standstill(noise: float) -> None:
    generator, rule = np.random.default_rng(0), Standstill(0.0, 120, None, ranked=10, dimension=2)
    for told in range(0, 20_000, 10):  # rises by the noise in 2000 evaluations
        rule.observe(100.0 + told / 2000 + noise * generator.standard_normal(10))
        assert rule.reasons(best_evaluation=1) == {}


def test_a_rare_success_that_becomes_less_rare_is_progress() -> None:
    generator, rule = np.random.default_rng(0), Standstill(0.0, 120, None, ranked=10, dimension=2)
    for told in range(0, 7000, 10):
        rule.observe((generator.random(10) < 0.05 + told / 8000).astype(float))
        assert rule.reasons(best_evaluation=1) == {}


def test_noise_without_progress_is_a_standstill() -> None:
    for seed in range(10):
        generator, rule = np.random.default_rng(seed), Standstill(0.0, 120, None, ranked=10, dimension=2)
        told, best, best_evaluation = 0, -np.inf, 0
        while not rule.reasons(best_evaluation):
            fitness = generator.standard_normal(10)
            rule.observe(fitness)
            if fitness.max() > best:
                best, best_evaluation = fitness.max(), told + int(fitness.argmax()) + 1
            told += 10
            assert told < 30_000
        assert list(rule.reasons(best_evaluation)) == ["stagnation"]


@pytest.mark.parametrize(
    ("tolfun", "difference", "flat"),
    [(0.0, 0.0, True), (0.0, 1e-14, True), (0.0, 1e-9, False), (1e-6, 1e-9, True), (1e-6, 1e-3, False)],
)
def test_fitness_is_flat_up_to_a_tolerance_and_to_rounding(tolfun: float, difference: float, flat: bool) -> None:
    rule = Standstill(tolfun, None, None, ranked=5, dimension=2)
    for g in range(22):  # 10 * 5 + 30 * 2 evaluations
        assert rule.reasons(0) == {}
        rule.observe(10.0 + difference * np.array([0.0, 0.1, 0.5, 0.3, float(g % 2)]))
    assert rule.reasons(0) == ({"flat": 110} if flat else {})


def test_one_value_apart_begins_the_count_anew() -> None:
    rule = Standstill(0.0, None, None, ranked=5, dimension=1)
    for g in range(16):
        rule.observe(np.array([1.0, 1.0, 1.0, 1.0, 2.0 if g == 9 else 1.0]))
    assert rule.reasons(0) == {}
    for _ in range(10):
        rule.observe(np.ones(5))
    assert rule.reasons(0) == {"flat": 80}


def test_a_stretched_distribution_is_named() -> None:
    search = XNES(np.zeros(2), [1.0, 1e5], seed=0, max_evaluations=10**5, max_condition=1e4)
    result = search.maximize(lambda x: float(x[0] - 1e-10 * abs(x[1])))
    assert list(result.stop) == ["condition"]
    assert result.stop["condition"] == search.condition > 1e4


def test_a_step_that_is_lost_in_rounding_stops_every_search() -> None:
    for make in SEARCHES.values():
        search = make(np.array([1e20, -1e20]), 1.0, seed=0, max_evaluations=5000)
        if search.name != "restarts":  # which begins elsewhere, and is no better off
            search.tell(search.ask(), np.zeros(len(search.ask())))
            assert "no_effect" in search.stop()
