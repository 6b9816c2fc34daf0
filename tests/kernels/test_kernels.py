from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from numba import njit, types
from numpy.typing import NDArray
from scipy import stats

from dpsearch.kernels import activations
from dpsearch.kernels.elementary import arctan2, exp, log, sigmoid, sincos, tanh
from dpsearch.kernels.lanes import FLOATS, INTS, LANES, ROWS, WIDTH, address_of, fetch_add, function_at, noise_rows
from dpsearch.kernels.matvec import matvec
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


def test_noise_rows_come_in_fours() -> None:
    assert [noise_rows(draws) for draws in (0, 1, 4, 5, 8)] == [0, 4, 4, 8, 8]


@njit  # type: ignore[untyped-decorator, unused-ignore]
def _elementary(x, out):
    for i in range(len(x)):
        out[0, i] = exp(x[i])
        out[1, i] = tanh(x[i])
        out[2, i] = sigmoid(x[i])
        out[3, i], out[4, i] = sincos(x[i])
        out[5, i] = log(abs(x[i]))


def elementary(x: Any) -> dict[str, NDArray[np.float64]]:
    x = np.array(x, np.float64)
    out = np.empty((6, len(x)))
    _elementary(x, out)
    return dict(zip(("exp", "tanh", "sigmoid", "sin", "cos", "log"), out, strict=True))


@njit  # type: ignore[untyped-decorator, unused-ignore]
def _angles(y, x, out):
    for i in range(len(x)):
        out[i] = arctan2(y[i], x[i])


def points(low: float, high: float) -> NDArray[np.float64]:
    random = np.random.default_rng(2)
    return np.concatenate([np.linspace(low, high, 20_001), random.uniform(low, high, 100_000)])


def error(ours: NDArray[np.floating], exact: NDArray[np.floating]) -> float:
    """The largest relative error; the reference has 64 bits of mantissa."""
    exact = np.asarray(exact, np.longdouble)
    return float(np.max(np.abs((ours - exact) / np.where(exact == 0, 1, exact))))


def test_exp_and_sigmoid_are_accurate_to_1e_14() -> None:
    x = points(-707, 708)
    exact = np.exp(x.astype(np.longdouble))
    assert error(elementary(x)["exp"], exact) < 1e-14
    assert error(elementary(x)["sigmoid"], 1 / (1 + 1 / exact)) < 1e-14


def test_tanh_is_accurate_to_1e_14_also_near_zero() -> None:
    small = np.concatenate([sign * 10.0 ** np.linspace(-300, 0, 3001) for sign in (-1, 1)])
    x = np.concatenate([points(-25, 25), small])
    assert error(elementary(x)["tanh"], np.tanh(x.astype(np.longdouble))) < 1e-14


def test_sine_and_cosine_are_accurate_to_1e_14_up_to_a_hundred_thousand_radians() -> None:
    x = np.concatenate([points(-4, 4), points(-1e5, 1e5), np.arange(-200, 200) * (np.pi / 2)])
    ours, exact = elementary(x), x.astype(np.longdouble)
    assert np.max(np.abs(ours["sin"] - np.sin(exact))) < 1e-14
    assert np.max(np.abs(ours["cos"] - np.cos(exact))) < 1e-14


def test_log_is_accurate_to_1e_14_over_all_normal_numbers() -> None:
    x = np.concatenate([points(1e-3, 3), 10.0 ** points(-307, 308), 1 + 10.0 ** points(-15, -1)])
    assert error(elementary(x)["log"], np.log(x.astype(np.longdouble))) < 1e-14


def test_angles_are_accurate_to_1e_14_in_all_directions() -> None:
    random = np.random.default_rng(3)
    y, x = random.standard_normal((2, 100_000)) * 10.0 ** random.uniform(-20, 20, (2, 100_000))
    y[:1000], x[:1000] = np.sin(points(-4, 4)[:1000]), np.cos(points(-4, 4)[:1000])
    ours = np.empty(len(x))
    _angles(y, x, ours)
    assert error(ours, np.arctan2(y.astype(np.longdouble), x.astype(np.longdouble))) < 1e-14


def test_angles_of_axes_and_the_origin() -> None:
    y, x = np.array([[0.0, 0.0, 1.0, -1.0, 0.0, 3.0, -3.0], [0.0, 2.0, 0.0, 0.0, -2.0, 3.0, -3.0]])
    ours = np.empty(len(x))
    _angles(y, x, ours)
    np.testing.assert_allclose(ours, np.arctan2(y, x), rtol=1e-15)


def test_elementary_functions_at_their_ends() -> None:
    at = elementary([0.0, -0.0, -1e4, 1e4, math.inf, -math.inf])
    assert at["exp"].tolist() == pytest.approx([1, 1, *[math.exp(x) for x in (-708, 709, 709, -708)]], rel=1e-14)
    assert at["tanh"].tolist() == [0, 0, -1, 1, 1, -1]
    assert at["sigmoid"][:2].tolist() == [0.5, 0.5]
    assert at["sigmoid"][2:].tolist() == pytest.approx([0, 1, 1, 0], abs=1e-300)
    assert at["sin"][:2].tolist() == [0, 0]
    assert at["cos"][:2].tolist() == [1, 1]
    assert elementary([1.0])["log"].tolist() == [0]


@njit  # type: ignore[untyped-decorator, unused-ignore]
def _activations(x, out):
    for i in range(len(x)):
        out[0, i] = activations.exp(x[i])
        out[1, i] = activations.sigmoid(x[i])
        out[2, i] = activations.tanh(x[i])


def in_precision(x: NDArray[np.floating]) -> list[NDArray[np.floating]]:
    """Exponential, sigmoid and hyperbolic tangent, in the precision of the arguments."""
    out = np.empty((3, len(x)), x.dtype)
    _activations(x, out)
    return list(out)


def test_activations_in_single_precision_are_accurate_to_its_rounding() -> None:
    x = points(-86, 87).astype(np.float32)
    exact = np.exp(x.astype(np.float64))
    exponential, sigmoid_of_x, _ = in_precision(x)
    assert error(exponential, exact) < 3e-7
    assert error(sigmoid_of_x, 1 / (1 + 1 / exact)) < 3e-7
    x = points(-12, 12).astype(np.float32)
    np.testing.assert_allclose(in_precision(x)[2], np.tanh(x.astype(np.float64)), rtol=3e-7, atol=2e-7)


def test_activations_in_single_precision_at_their_ends() -> None:
    at = in_precision(np.array([0.0, -0.0, -1e4, 1e4, math.inf, -math.inf], np.float32))
    assert at[0][:2].tolist() == [1, 1]
    assert at[1].tolist() == pytest.approx([0.5, 0.5, 0, 1, 1, 0], abs=1e-30)
    assert at[2].tolist() == pytest.approx([0, 0, -1, 1, 1, -1], rel=1e-7)


def test_activations_in_double_precision_are_the_elementary_functions() -> None:
    x = points(-30, 30)
    for ours, name in zip(in_precision(x), ("exp", "sigmoid", "tanh"), strict=True):
        np.testing.assert_array_equal(ours, elementary(x)[name])


@njit  # type: ignore[untyped-decorator, unused-ignore]
def _matvec(weights, offset, rows, columns, x, output, lanes=LANES):
    matvec(weights, offset, rows, columns, x, output, lanes)


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize(("rows", "columns"), [(0, 3), (1, 1), (3, 5), (4, 4), (9, 7), (40, 13)])
def test_matvec_is_the_product_of_matrix_and_vector(rows: int, columns: int, shared: bool) -> None:
    random = np.random.default_rng(rows)
    offset = 5
    weights = random.normal(size=offset + rows * columns + 2 if shared else (offset + rows * columns + 2, LANES))
    x, output = random.normal(size=(columns + 1, LANES)), random.normal(size=(rows + 1, LANES))
    before = output.copy()
    _matvec(weights, offset, rows, columns, x, output)
    matrix = weights[offset : offset + rows * columns].reshape(rows, columns, *weights.shape[1:])
    product = np.einsum("rc,cl->rl" if shared else "rcl,cl->rl", matrix, x[:columns])
    np.testing.assert_allclose(output[:rows], product, rtol=1e-13, atol=1e-13)
    assert (output[rows] == before[rows]).all()  # nothing beyond the rows asked for


def test_matvec_fuses_each_product_with_its_sum_in_the_order_of_the_columns() -> None:
    random = np.random.default_rng(9)
    rows, columns = 5, 6
    weights, x = random.normal(size=rows * columns), random.normal(size=(columns, LANES))
    output = np.zeros((rows, LANES))
    _matvec(weights, 0, rows, columns, x, output)
    for row in range(rows):
        for lane in range(LANES):
            total = 0.0
            for column in range(columns):
                product = Fraction(weights[row * columns + column]) * Fraction(x[column, lane])
                total = float(product + Fraction(total))  # rounded once
            assert output[row, lane] == total


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("lanes", range(WIDTH, LANES, WIDTH))
def test_matvec_of_fewer_lanes_gives_the_same_and_touches_no_others(lanes: int, shared: bool) -> None:
    random = np.random.default_rng(lanes)
    rows, columns = 7, 5
    weights = random.normal(size=rows * columns if shared else (rows * columns, LANES))
    x = random.normal(size=(columns, LANES))
    every, some, packed = np.zeros((rows, LANES)), np.zeros((rows, LANES)), np.zeros(rows * LANES)
    _matvec(weights, 0, rows, columns, x, every)
    _matvec(weights, 0, rows, columns, x, some, lanes)
    np.testing.assert_array_equal(some[:, :lanes], every[:, :lanes])
    assert (some[:, lanes:] == 0.0).all()
    _matvec(weights, 0, rows, columns, x, packed, lanes)  # into one row, without gaps
    np.testing.assert_array_equal(packed[: rows * lanes].reshape(rows, lanes), every[:, :lanes])


@pytest.mark.parametrize("written", ["float32", "float64"])
def test_matvec_in_single_precision_may_write_either(written: str) -> None:
    random = np.random.default_rng(4)
    weights, x = random.normal(size=7 * 5).astype(np.float32), random.normal(size=(5, LANES)).astype(np.float32)
    output: NDArray[Any] = np.empty((7, LANES), written)
    _matvec(weights, 0, 7, 5, x, output)
    np.testing.assert_allclose(output, weights.reshape(7, 5).astype(np.float64) @ x, rtol=1e-6, atol=1e-6)


@njit(types.void(INTS, INTS), nogil=True)
def _take(counter, taken):
    for i in range(len(taken)):
        taken[i] = fetch_add(counter)


def test_fetch_add_gives_every_number_once_to_competing_threads() -> None:
    counter = np.array([10], np.int64)
    taken = [np.empty(50_000, np.int64) for _ in range(4)]
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda mine: _take(counter, mine), taken))
    assert counter[0] == 200_010
    assert sorted(np.concatenate(taken)) == list(range(10, 200_010))


_DOUBLE_IT = types.void(FLOATS)
_doubler_at = function_at(_DOUBLE_IT)


@njit(_DOUBLE_IT)
def _double_it(x):
    for i in range(len(x)):
        x[i] *= 2.0


@njit(types.void(types.int64, FLOATS), nogil=True)
def _call(address, x):
    _doubler_at(address)(x)


def test_a_compiled_function_can_be_called_by_its_address() -> None:
    x = np.arange(3.0)
    _call(address_of(_double_it, _DOUBLE_IT), x)
    assert x.tolist() == [0, 2, 4]
    assert address_of(_double_it, _DOUBLE_IT) == address_of(_double_it, _DOUBLE_IT)


def test_lane_arrays_are_float64_rows_with_the_lane_last() -> None:
    assert str(ROWS) == "array(float64, 2d, C)"
    assert str(FLOATS) == "array(float64, 1d, C)"
    assert uniforms(0, 0, 0).shape == (4, LANES)
