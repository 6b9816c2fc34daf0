"""A search is a function of its seed and goes on from its state bit for bit."""

from __future__ import annotations

import copy
import io
import pickle
import warnings
from typing import Any

import numpy as np
import pytest
import torch
from threadpoolctl import threadpool_limits

from dpsearch.search import CMAES, FEM, NES, XNES, Restarts, Search
from tests.support.searches import SEARCHES, Array, Maker, evaluated, generation, valley


@pytest.fixture(params=SEARCHES)
def make(request: pytest.FixtureRequest) -> Maker:
    return SEARCHES[request.param]


def mixed_generation(search: Search, g: int) -> Array:
    """A generation with a NaN now and then, and now and then with points told in place of those asked."""
    points = search.ask()
    if g % 3 == 1:
        points[0] = 0.5 * (points[0] + search.mean)
    fitness = np.array([-valley(x) for x in points])
    if g % 4 == 2:
        fitness[-1] = np.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        search.tell(points, fitness)
    search.stop()  # looking must not change anything
    return points


def test_the_same_seed_gives_the_same_run_and_another_seed_another(make: Maker) -> None:
    first, again, other = (evaluated(make(np.ones(3), 0.5, seed=seed), 15) for seed in (7, 7, 8))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first[:1], other[:1])


def test_a_seed_is_drawn_and_kept_where_none_is_given(make: Maker) -> None:
    first, other = make(np.ones(3), 0.5), make(np.ones(3), 0.5)
    assert first.seed != other.seed
    np.testing.assert_array_equal(evaluated(first, 5), evaluated(make(np.ones(3), 0.5, seed=first.seed), 5))


def test_global_randomness_is_neither_used_nor_touched(make: Maker) -> None:
    runs = []
    for seed in (1, 2):
        np.random.seed(seed)  # noqa: NPY002
        before = [np.array(part) for part in np.random.get_state()]  # noqa: NPY002
        runs.append(evaluated(make(np.ones(3), 0.5, seed=7), 10))
        for part, kept in zip(np.random.get_state(), before, strict=True):  # noqa: NPY002
            np.testing.assert_array_equal(part, kept)
    np.testing.assert_array_equal(runs[0], runs[1])


@pytest.mark.parametrize("asked", [False, True])
@pytest.mark.parametrize("done", [0, 1, 2, 13])
def test_a_new_search_goes_on_from_a_state_bit_for_bit(make: Maker, done: int, asked: bool) -> None:
    search = make(np.ones(3), 0.5, seed=7)
    for g in range(done):
        mixed_generation(search, g)
    if asked:
        search.ask()
    state = search.state_dict()
    heir = make(np.ones(3), 0.5, seed=99)
    heir.load_state_dict(state)
    for g in range(done, done + 15):
        np.testing.assert_array_equal(mixed_generation(search, g), mixed_generation(heir, g))
    for here, there in zip(leaves(search.state_dict()), leaves(heir.state_dict()), strict=True):
        np.testing.assert_array_equal(here, there)
    assert (search.best.fitness, search.best.evaluation) == (heir.best.fitness, heir.best.evaluation)
    assert search.stop() == heir.stop()


def leaves(state: Any) -> list[Any]:
    return [leaf for value in state.values() for leaf in leaves(value)] if isinstance(state, dict) else [state]


@pytest.mark.parametrize("done", [0, 6])
def test_a_search_that_went_on_goes_back_to_its_state(make: Maker, done: int) -> None:
    search = make(np.ones(3), 0.5, seed=7)
    for g in range(done):
        mixed_generation(search, g)
    state = search.state_dict()
    first = [mixed_generation(search, g) for g in range(done, done + 12)]
    search.load_state_dict(state)
    for g, points in enumerate(first, start=done):
        np.testing.assert_array_equal(mixed_generation(search, g), points)


def test_a_state_can_be_taken_over_and_over(make: Maker) -> None:
    search = make(np.ones(3), 0.5, seed=7)
    expected = make(np.ones(3), 0.5, seed=7)
    for g in range(12):
        heir = make(np.ones(3), 0.5, seed=0)
        heir.load_state_dict(search.state_dict())
        search = heir
        np.testing.assert_array_equal(mixed_generation(search, g), mixed_generation(expected, g))


def test_a_state_does_not_change_as_the_search_goes_on(make: Maker) -> None:
    search, other = make(np.ones(3), 0.5, seed=7), make(np.ones(3), 0.5, seed=7)
    for g in range(6):
        mixed_generation(search, g)
    state = search.state_dict()
    before = [np.array(leaf) for leaf in leaves(state)]
    other.load_state_dict(state)
    for g in range(6, 15):
        mixed_generation(search, g)
        mixed_generation(other, g + 1)
    for leaf, kept in zip(leaves(state), before, strict=True):
        np.testing.assert_array_equal(leaf, kept)


def swapped(value: Any, kind: type, to: Any) -> Any:
    if isinstance(value, dict):
        return {key: swapped(item, kind, to) for key, item in value.items()}
    return to(value) if isinstance(value, kind) else value


@pytest.mark.parametrize("seed", [7, np.int64(7), np.uint64(2**64 - 1)])
def test_a_state_is_numbers_and_arrays_that_torch_loads_safely(make: Maker, seed: int) -> None:
    search = make(np.ones(3), 0.5, seed=seed)
    for g in range(8):
        mixed_generation(search, g)
    state = search.state_dict()
    assert {type(leaf) for leaf in leaves(state)} <= {int, float, str, np.ndarray}
    file = io.BytesIO()
    torch.save(swapped(state, np.ndarray, torch.from_numpy), file)
    file.seek(0)
    loaded = swapped(torch.load(file, weights_only=True), torch.Tensor, torch.Tensor.numpy)
    heir = make(np.ones(3), 0.5, seed=0)
    heir.load_state_dict(loaded)
    for g in range(8, 14):
        np.testing.assert_array_equal(mixed_generation(search, g), mixed_generation(heir, g))


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda search: pickle.loads(pickle.dumps(search))])
def test_a_copy_in_the_middle_of_a_generation_goes_on_alike(make: Maker, copied: Any) -> None:
    search = make(np.ones(3), 0.5, seed=7)
    for g in range(5):
        mixed_generation(search, g)
    points = search.ask()
    twin = copied(search)
    for s in (search, twin):
        s.tell(points, [-valley(x) for x in points])
    for g in range(5, 12):
        np.testing.assert_array_equal(mixed_generation(search, g), mixed_generation(twin, g))


def test_a_state_of_another_kind_of_search_is_refused() -> None:
    with pytest.raises(ValueError, match="the state is of a search by nes, this search is by xnes"):
        XNES(np.ones(3), 0.5).load_state_dict(NES(np.ones(3), 0.5).state_dict())


@pytest.mark.parametrize("generations", [0, 3])
def test_a_state_of_another_dimension_is_refused_and_changes_nothing(make: Maker, generations: int) -> None:
    other = make(np.ones(4), 0.5, seed=7)
    for _ in range(generations):
        generation(other)
    search, expected = make(np.ones(5), 0.5, seed=1), make(np.ones(5), 0.5, seed=1)
    for s in (search, expected):
        evaluated(s, 2)
    with pytest.raises(ValueError, match="the state is of dimension 4, this search of dimension 5"):
        search.load_state_dict(other.state_dict())
    np.testing.assert_array_equal(evaluated(search, 3), evaluated(expected, 3))


def test_a_state_that_lacks_something_is_refused_and_changes_nothing(make: Maker) -> None:
    search, expected = make(np.ones(3), 0.5, seed=1), make(np.ones(3), 0.5, seed=1)
    state = make(np.ones(3), 0.5, seed=7).state_dict()
    evaluated(search, 2)
    evaluated(expected, 2)
    for name in ("best_x", "seed", "dimension"):
        with pytest.raises(KeyError, match=name):
            search.load_state_dict({k: v for k, v in state.items() if k != name})
    np.testing.assert_array_equal(evaluated(search, 3), evaluated(expected, 3))


def test_telling_needs_a_new_ask_after_a_state_is_loaded(make: Maker) -> None:
    search = make(np.ones(3), 0.5, seed=1)
    points = search.ask()
    search.load_state_dict(search.state_dict())
    with pytest.raises(RuntimeError, match="call ask"):
        search.tell(points, np.zeros(len(points)))


WIDE: dict[str, Any] = {
    "nes": lambda: NES(np.ones(20), 0.5, population=400, seed=3),
    "xnes": lambda: XNES(np.ones(200), 0.5, population=200, seed=3),
    "fem": lambda: FEM(np.ones(200), 0.5, window=5, top=5, seed=3),
    "cmaes": lambda: CMAES(np.ones(200), 0.5, population=60, seed=3),
    "restarts": lambda: Restarts(XNES, np.ones(200), 0.5, population=60, patience=100, seed=3),
}
"""Large enough that linear algebra would use more than one thread if it could."""


@pytest.mark.parametrize("name", WIDE)
def test_neither_a_run_nor_its_resumption_depends_on_the_number_of_threads(name: str) -> None:
    def run(threads: int) -> Array:
        with threadpool_limits(threads, user_api="blas"):
            search = WIDE[name]()
            evaluated(search, 8)
            heir = WIDE[name]()
            heir.load_state_dict(search.state_dict())
            return np.concatenate([generation(heir) for _ in range(4)])

    np.testing.assert_array_equal(run(1), run(2))
