"""Counter-based random numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from dpsearch.kernels.lanes import LANES, WIDTH
from dpsearch.kernels.philox import ACTION, ENVIRONMENT, draw, episode_seeds, philox4x32, stream_key

ONES = 0xFFFFFFFF


def plain_philox(counter: list[int], key: list[int]) -> list[int]:
    """Philox4x32-10 as its authors write it, in whole numbers."""
    c, k = list(counter), list(key)
    for _ in range(10):
        p0, p1 = 0xD2511F53 * c[0], 0xCD9E8D57 * c[2]
        c = [(p1 >> 32) ^ c[1] ^ k[0], p1 & ONES, (p0 >> 32) ^ c[3] ^ k[1], p0 & ONES]
        k = [(k[0] + 0x9E3779B9) & ONES, (k[1] + 0xBB67AE85) & ONES]
    return c


def compiled_philox(counters: Any, keys: Any) -> list[list[int]]:
    words = np.empty((len(counters), 4), np.uint64)
    philox4x32(np.array(counters, np.uint64), np.array(keys, np.uint64), words)
    return [[int(word) for word in row] for row in words]


def uniforms(
    key: int, episodes: Any, steps: Any, purpose: int = ENVIRONMENT, rows: int = 4, lanes: int = LANES
) -> NDArray[np.float64]:
    noise = np.zeros((rows, LANES))
    numbers = np.full(LANES, episodes, np.uint64), np.full(LANES, steps, np.int64)
    draw(np.uint64(key), *numbers, purpose, noise, lanes)
    return noise


def stream(key: int, count: int, rows: int = 4) -> NDArray[np.float64]:
    """The numbers of sixteen neighbouring episodes, ``(steps, rows, LANES)``."""
    return np.stack([uniforms(key, np.arange(LANES), t, rows=rows) for t in range(count)])


@pytest.mark.parametrize(
    ("counter", "key", "words"),
    [
        ([0] * 4, [0] * 2, [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
        ([ONES] * 4, [ONES] * 2, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
        (
            [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
            [0xA4093822, 0x299F31D0],
            [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
        ),
    ],
)
def test_philox_gives_the_published_reference_vectors(counter: list[int], key: list[int], words: list[int]) -> None:
    assert compiled_philox([counter], [key]) == [words]
    assert plain_philox(counter, key) == words


def test_philox_agrees_with_plain_python_on_random_input() -> None:
    random = np.random.default_rng(0)
    counters, keys = random.integers(2**32, size=(300, 4)), random.integers(2**32, size=(300, 2))
    expected = [plain_philox(counter, key) for counter, key in zip(counters.tolist(), keys.tolist(), strict=True)]
    assert compiled_philox(counters, keys) == expected


@pytest.mark.parametrize("purpose", [ENVIRONMENT, ACTION])
def test_a_draw_is_a_function_of_key_episode_step_and_purpose(purpose: int) -> None:
    random = np.random.default_rng(1)
    key = int(random.integers(2**64, dtype=np.uint64))
    episodes = random.integers(2**64, size=LANES, dtype=np.uint64)
    steps = random.integers(2**32, size=LANES)
    noise = uniforms(key, episodes, steps, purpose, rows=8)
    for lane in range(LANES):
        episode, step = int(episodes[lane]), int(steps[lane])
        words = []
        for block in range(2):
            counter = [step, 2 * block + purpose, episode & ONES, episode >> 32]
            words += plain_philox(counter, [key & ONES, key >> 32])
        assert noise[:, lane].tolist() == [(word + 0.5) / 2**32 for word in words]


def test_a_draw_does_not_depend_on_the_lane() -> None:
    noise = uniforms(7, 123456789, 42)
    assert (noise == noise[:, :1]).all()


@pytest.mark.parametrize("lanes", [1, WIDTH, WIDTH + 3])
def test_a_draw_for_fewer_lanes_gives_the_same_and_touches_no_others(lanes: int) -> None:
    every, some = uniforms(7, np.arange(LANES), 42), uniforms(7, np.arange(LANES), 42, lanes=lanes)
    np.testing.assert_array_equal(some[:, :lanes], every[:, :lanes])
    assert (some[:, lanes:] == 0.0).all()


def test_draws_are_strictly_between_zero_and_one() -> None:
    assert 0 < 0.5 / 2**32
    assert (ONES + 0.5) / 2**32 < 1
    numbers = stream(3, 500)
    assert numbers.min() > 0
    assert numbers.max() < 1


def test_draws_are_uniform() -> None:
    numbers = stream(stream_key(0), 20_000).ravel()  # 1.28 million
    assert stats.kstest(numbers, "uniform").pvalue > 1e-3
    for bins in (256, 4096):
        assert stats.chisquare(np.bincount((numbers * bins).astype(int), minlength=bins)).pvalue > 1e-3


def test_low_bits_of_draws_are_uniform() -> None:
    words = (stream(stream_key(1), 20_000).ravel() * 2**32).astype(np.int64)
    assert stats.chisquare(np.bincount(words & 255, minlength=256)).pvalue > 1e-3


@pytest.mark.parametrize("neighbour", ["next step", "next episode", "next row", "next seed", "next purpose"])
def test_neighbouring_draws_are_independent(neighbour: str) -> None:
    """Uncorrelated and jointly uniform, although they differ by one in a single word of the counter."""
    key = stream_key(5)
    x = stream(key, 8000)
    if neighbour == "next step":
        x, y = x[:-1], x[1:]
    elif neighbour == "next episode":
        x, y = x[:, :, :-1], x[:, :, 1:]
    elif neighbour == "next row":
        x, y = x[:, :-1], x[:, 1:]
    elif neighbour == "next seed":
        y = stream(stream_key(6), len(x))
    else:
        y = np.stack([uniforms(key, np.arange(LANES), t, ACTION) for t in range(len(x))])
    x, y = x.ravel(), y.ravel()
    assert abs(np.corrcoef(x, y)[0, 1]) * math.sqrt(len(x)) < 4
    cells = (x * 32).astype(int) * 32 + (y * 32).astype(int)
    assert stats.chisquare(np.bincount(cells, minlength=1024)).pvalue > 1e-3


def test_stream_keys_of_seeds_and_purposes_all_differ() -> None:
    keys = {stream_key(seed, purpose) for seed in range(200) for purpose in range(20)}
    assert len(keys) == 4000
    assert all(0 <= key < 2**64 for key in keys)


@pytest.mark.parametrize(("seed", "purpose"), [(-1, 0), (2**64, 0), (0, -1), (0, 2**32)])
def test_stream_key_refuses_numbers_out_of_range(seed: int, purpose: int) -> None:
    with pytest.raises(ValueError, match="must be in"):
        stream_key(seed, purpose)


def test_episode_seeds_are_distinct_and_fit_other_generators() -> None:
    seeds = episode_seeds(stream_key(3), np.arange(2**40, 2**40 + 2000, dtype=np.uint64))
    assert seeds.min() >= 0
    assert seeds.max() < 2**31
    assert len(set(seeds.tolist())) > 1990  # 2000 out of 2**31: one collision in a thousand such sets
    counter = [0, 0, 0, 2**40 >> 32]
    key = stream_key(3)
    assert seeds[0] == plain_philox(counter, [key & ONES, key >> 32])[0] >> 1
