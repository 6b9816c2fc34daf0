"""What every search promises: asking, telling, stopping and refusing."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest

from dpsearch.search import SEARCHES as TYPES
from dpsearch.search import SNES, XNES, Search
from dpsearch.search.gaussian import GaussianSearch
from tests.support.searches import SEARCHES, Maker, evaluated, generation, valley


@pytest.fixture(params=SEARCHES)
def make(request: pytest.FixtureRequest) -> Maker:
    return SEARCHES[request.param]


def test_searches_go_by_their_names() -> None:
    assert {name: search.name for name, search in TYPES.items()} == {name: name for name in TYPES}
    assert set(TYPES) == {"nes", "xnes", "snes", "fem", "cmaes"}


def test_asking_again_gives_the_same_points_until_they_are_told(make: Maker) -> None:
    search = make(np.ones(3), 0.5, seed=0)
    for _ in range(3):
        first = search.ask()
        again = search.ask()
        np.testing.assert_array_equal(again, first)
        again[:] = 0.0  # the caller's own copy
        np.testing.assert_array_equal(search.ask(), first)
        search.tell(first, [-valley(x) for x in first])
        assert not np.array_equal(search.ask(), first)


@pytest.mark.parametrize("name", sorted(set(SEARCHES) - {"cmaes", "restarts"}))
def test_points_told_in_place_of_those_asked_are_what_is_learned_from(name: str) -> None:
    search = SEARCHES[name](np.ones(3), 0.5, seed=0)
    assert isinstance(search, GaussianSearch)
    evaluated(search, 10)
    asked, mean, factor, best = search.ask(), search.mean, search.factor, search.best.fitness
    repaired = np.maximum(asked, mean - 0.1)
    root = np.diag(factor) if factor.ndim == 1 else factor
    local = np.array([np.linalg.solve(root, x - mean) for x in repaired])
    twin = SEARCHES[name](np.ones(3), 0.5, seed=0)
    assert isinstance(twin, GaussianSearch)
    twin.load_state_dict(search.state_dict())
    twin.ask()
    twin._local = local  # as if these had been drawn
    fitness = [-valley(x) for x in repaired]
    twin.tell(twin.ask(), fitness)
    search.tell(repaired, fitness)
    np.testing.assert_allclose(search.mean, twin.mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(search.factor, twin.factor, rtol=0, atol=1e-12)
    assert search.best.fitness == max(best, *fitness)


@pytest.mark.parametrize(
    ("argument", "arguments"),
    [
        ("x0", {"x0": [0.0, np.nan]}),
        ("x0", {"x0": [0.0, np.inf]}),
        ("x0", {"x0": []}),
        ("x0", {"x0": 1.0}),
        ("x0", {"x0": [[1.0, 2.0]]}),
        ("sigma0", {"sigma0": 0.0}),
        ("sigma0", {"sigma0": -1.0}),
        ("sigma0", {"sigma0": np.nan}),
        ("sigma0", {"sigma0": [1.0, 0.0]}),
        ("sigma0", {"sigma0": [1.0, 1.0, 1.0]}),
        ("seed", {"seed": -1}),
        ("x0", {"x0": "ab"}),
        ("x0", {"x0": None}),
        ("x0", {"x0": [1.0, [2.0]]}),
        ("x0", {"x0": [1j, 0.0]}),
        ("x0", {"x0": np.zeros((50, 50))}),
        ("sigma0", {"sigma0": "wide"}),
        ("sigma0", {"sigma0": 1e-200}),
        ("sigma0", {"sigma0": 1e200}),
        ("seed", {"seed": 2**64}),
        ("seed", {"seed": True}),
        ("seed", {"seed": 1.5}),
        ("seed", {"seed": "1"}),
        ("max_evaluations", {"max_evaluations": 0}),
        ("max_evaluations", {"max_evaluations": 10.5}),
        ("max_evaluations", {"max_evaluations": np.inf}),
        ("max_evaluations", {"max_evaluations": np.True_}),
        ("target", {"target": "high"}),
    ],
)
def test_an_argument_out_of_range_is_named(make: Maker, argument: str, arguments: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=rf"^{argument} must [^\n]*$"):
        make(**{"x0": np.zeros(2), "sigma0": 1.0, **arguments})


@pytest.mark.parametrize("name", ["nes", "xnes", "snes", "fem-batch", "cmaes"])
def test_a_population_or_patience_too_small_is_named(name: str) -> None:
    make = TYPES[name.removesuffix("-batch")]
    options: dict[str, Any] = {"online": False} if name == "fem-batch" else {}
    with pytest.raises(ValueError, match=r"^population must be a whole number, at least 2, got 1$"):
        make(np.zeros(2), 1.0, population=1, **options)
    with pytest.raises(ValueError, match=r"^patience must be a whole number, at least 1, got 0$"):
        make(np.zeros(2), 1.0, patience=0)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"seed": np.int64(7), "max_evaluations": np.int32(30)}, {"seed": 7, "max_evaluations": 30}),
        ({"seed": np.array(7), "max_evaluations": 1e2, "target": np.float32(0.5)}, {"seed": 7, "target": 0.5}),
        ({"tolx": np.float64(1e-3)}, {"tolx": 1e-3}),
    ],
)
def test_numbers_of_numpy_become_pythons_own(options: dict[str, Any], expected: dict[str, Any]) -> None:
    search = XNES(np.zeros(2, np.float32), np.float64(1.0), **options)
    for name, value in expected.items():
        assert getattr(search, name) == value
        assert type(getattr(search, name)) in (int, float)


@pytest.mark.parametrize("name", sorted(set(SEARCHES) - {"restarts"}))
@pytest.mark.parametrize(("argument", "hint"), [("popsize", " (here it is called population)"), ("bounds", "")])
def test_an_unknown_argument_is_named_with_those_that_there_are(name: str, argument: str, hint: str) -> None:
    make: Any = SEARCHES[name]
    kind = getattr(make, "func", make).__name__
    with pytest.raises(TypeError) as error:
        make(np.zeros(2), 1.0, **{argument: 5})
    message = str(error.value)
    assert message.startswith(f"{argument} is not an argument of {kind}{hint}; it accepts x0, sigma0, ")
    assert "population" in message
    assert "\n" not in message


def test_the_ends_of_the_range_of_seeds_work(make: Maker) -> None:
    first, last = (make(np.zeros(2), 1.0, seed=seed).ask() for seed in (0, 2**64 - 1))
    assert not np.array_equal(first, last)


def test_telling_before_asking_is_an_error(make: Maker) -> None:
    search = make(np.zeros(2), 1.0, seed=0)
    with pytest.raises(RuntimeError, match="call ask"):
        search.tell(np.zeros((4, 2)), np.zeros(4))
    generation(search)
    with pytest.raises(RuntimeError, match="call ask"):
        search.tell(np.zeros((4, 2)), np.zeros(4))


def test_wrong_shapes_and_points_that_are_not_finite_are_refused_and_change_nothing(make: Maker) -> None:
    search = make(np.zeros(2), 1.0, seed=0)
    points = search.ask()
    n = len(points)
    for told, fitness in (
        (points, np.zeros(n + 1)),
        (points, np.zeros((n, 1))),
        (points, 0.0),
        (np.vstack([points, points]), np.zeros(2 * n)),
        (points[:, :1], np.zeros(n)),
        (points.T if n != 2 else points[0], np.zeros(n)),
    ):
        with pytest.raises(ValueError, match=r"tell\(\) expects points .* got"):
            search.tell(told, fitness)
    with pytest.raises(ValueError, match="NaN or infinite coordinate"):
        search.tell(np.full_like(points, np.nan), np.zeros(n))
    np.testing.assert_array_equal(search.ask(), points)
    assert (search.evaluations, search.generations, search.invalid) == (0, 0, 0)


@pytest.mark.parametrize("name", sorted(set(SEARCHES) - {"cmaes"}))
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_invalid_fitness_ranks_worst(name: str, bad: float) -> None:
    broken, spared = (SEARCHES[name](np.ones(3), 0.5, seed=0) for _ in range(2))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for g in range(12):
            points = spared.ask()
            np.testing.assert_array_equal(broken.ask(), points)
            fitness = np.array([-valley(x) for x in points])
            worst = g % 3 == 0
            broken.tell(points, np.r_[bad, fitness[1:]] if worst else fitness)
            spared.tell(points, np.r_[-1e9, fitness[1:]] if worst else fitness)
    assert broken.invalid == broken.result.invalid == 4
    assert broken.best.fitness == spared.best.fitness


def test_invalid_fitness_is_warned_of_once(make: Maker) -> None:
    search = make(np.ones(3), 0.5, seed=0)
    values = np.zeros(len(search.ask()))
    values[0] = np.nan
    with pytest.warns(UserWarning, match="ranked worst"):
        search.tell(search.ask(), values)
    values = np.full(len(search.ask()), np.nan)
    search.tell(search.ask(), values)  # a second warning would be an error
    assert search.invalid == 1 + len(values)


def test_a_search_survives_generations_without_any_valid_fitness(make: Maker) -> None:
    search = make(np.ones(3), 0.5, seed=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for _ in range(5):
            search.tell(search.ask(), np.full(len(search.ask()), np.nan))
    assert search.best.x is None
    assert (search.best.fitness, search.best.evaluation) == (-np.inf, 0)
    evaluated(search, 20)
    assert search.best.x is not None
    assert np.isfinite(search.mean).all()
    assert (search.stds > 0).all()


def test_best_and_result_tell_what_was_told(make: Maker) -> None:
    search = make(np.ones(3), 0.5, seed=0)
    told: list[tuple[float, list[float]]] = []
    for g in range(1, 9):
        for x in generation(search):
            told.append((-valley(x), x.tolist()))
        fitness = [f for f, _ in told]
        first = int(np.argmax(fitness))
        best, result = search.best, search.result
        assert (best.fitness, best.evaluation) == (fitness[first], first + 1)
        assert best.x is not None
        assert best.x.tolist() == told[first][1]
        assert (result.evaluations, result.generations, result.invalid) == (len(told), g, 0)
        np.testing.assert_array_equal(result.mean, search.mean)
        np.testing.assert_array_equal(result.stds, search.stds)
        assert result.stop == search.stop()


def test_what_a_search_hands_out_are_copies(make: Maker) -> None:
    search = make(np.ones(3), 0.5, seed=0)
    evaluated(search, 10)
    assert search.best.x is not None
    expected = search.best.x.copy()
    mean, stds = search.mean, search.stds
    for handed in (search.best.x, search.mean, search.stds, search.result.best.x):
        assert handed is not None
        handed[:] = 99.0
    np.testing.assert_array_equal(search.best.x, expected)
    np.testing.assert_array_equal(search.mean, mean)
    np.testing.assert_array_equal(search.stds, stds)
    x0 = np.ones(3)
    search = make(x0, 0.5, seed=0)
    x0[:] = 99.0
    np.testing.assert_array_equal(search.mean, np.ones(3))


def test_a_target_stops(make: Maker) -> None:
    search = make(np.ones(3), 0.5, seed=0, target=-2.0)
    result = search.maximize(lambda x: -float(x @ x))
    assert result.stop["target"] == result.best.fitness >= -2.0
    assert result.best.evaluation > result.evaluations - len(search.ask()) - 100


def test_max_evaluations_stops(make: Maker) -> None:
    search = make(np.ones(3), 0.5, seed=0, max_evaluations=70)
    calls = []
    result = search.maximize(lambda x: calls.append(1) or -float(x @ x))  # type: ignore[func-returns-value]
    assert 70 <= result.evaluations == len(calls) < 70 + 45
    assert result.stop["max_evaluations"] == result.evaluations


def test_tolx_stops_a_search_that_has_shrunk() -> None:
    search = SNES(np.ones(2), [1.0, 100.0], seed=0, tolx=1e-3, max_evaluations=10**5)
    result = search.maximize(lambda x: -float(x @ x))
    assert list(result.stop) == ["tolx"]
    assert result.stop["tolx"] == (result.stds / [1.0, 100.0]).max() < 1e-3


def test_patience_stops_a_search_in_vain() -> None:
    search = XNES(np.ones(2), 1.0, seed=0, patience=50, max_evaluations=10**5)
    values = iter([1.0, 2.0, *[0.0] * 1000])
    result = search.maximize(lambda x: next(values))
    assert result.stop == {"patience": result.evaluations - 2}
    assert 52 <= result.evaluations < 52 + search.population


def test_reasons_come_together() -> None:
    search = XNES(np.ones(2), 1.0, seed=0, patience=1, max_evaluations=1, target=-1e9, tolx=1e9)
    assert search.stop() == {}
    evaluated(search, 1)
    assert {"target", "max_evaluations", "tolx"} <= set(search.stop())


def test_a_callback_stops(make: Maker) -> None:
    seen: list[int] = []

    def callback(search: Search) -> bool | None:
        seen.append(search.generations)
        return False if search.generations == 4 else None

    result = make(np.ones(3), 0.5, seed=0).maximize(lambda x: -float(x @ x), callback=callback)
    assert seen == [1, 2, 3, 4]
    assert result.generations == 4


@pytest.mark.parametrize("answer", [False, np.False_, 0, 0.0])
def test_whatever_is_false_stops_but_none(make: Maker, answer: object) -> None:
    search = make(np.ones(3), 0.5, seed=0)
    assert search.maximize(lambda x: 0.0, callback=lambda _: answer).generations == 1
    endless = make(np.ones(3), 0.5, seed=0, max_evaluations=200)
    assert "max_evaluations" in endless.maximize(lambda x: -float(x @ x), callback=lambda _: None).stop


def test_a_fitness_that_writes_into_its_argument_changes_nothing(make: Maker) -> None:
    def scribble(x: Any) -> float:
        value = -valley(x)
        x[:] = 1e9
        return value

    tidy, untidy = (make(np.ones(3), 0.5, seed=0, max_evaluations=300) for _ in range(2))
    first, second = tidy.maximize(lambda x: -valley(x)), untidy.maximize(scribble)
    np.testing.assert_array_equal(second.mean, first.mean)
    assert second.best.fitness == first.best.fitness
    np.testing.assert_array_equal(np.asarray(second.best.x), np.asarray(first.best.x))


def test_what_is_no_number_is_not_told(make: Maker) -> None:
    search = make(np.ones(3), 0.5, seed=0)
    points = search.ask()
    for told, fitness, name in ((points, ["high"] * len(points), "fitness"), ("here", points[:, 0], "points")):
        with pytest.raises(ValueError, match=rf"^{name} must be numbers, got [^\n]*$"):
            search.tell(told, fitness)


def test_maximize_refuses_to_go_on_for_ever(make: Maker) -> None:
    with pytest.raises(ValueError, match="target, max_evaluations or a callback"):
        make(np.ones(3), 0.5, seed=0).maximize(lambda x: 0.0)


@pytest.mark.parametrize(
    ("argument", "value"), [("population", 20.5), ("target", np.nan), ("tolx", -1.0), ("tolx", np.nan)]
)
def test_a_value_of_no_use_is_refused(argument: str, value: float) -> None:
    options: dict[str, Any] = {argument: value}
    with pytest.raises(ValueError, match=argument):
        SNES(np.zeros(2), 1.0, **options)


def test_a_search_without_bounds_stops_before_numbers_overflow() -> None:
    result = SNES(np.zeros(3), 1.0, max_evaluations=10**6, seed=0).maximize(lambda x: float(x[0]))
    assert list(result.stop) == ["diverged"]
    assert np.isfinite(result.mean).all()
