"""Keyed, counter-based randomness: Philox4x32-10 of Salmon, Moraes, Dror and Shaw (SC 2011, section 3.3).

A random number here is a pure function of *which* number it is: (key, episode, step, purpose). Nothing is consumed,
so nothing depends on how many lanes, threads, workers or machines there are, nor on a restart.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dpsearch.kernels.on_demand import on_demand

ENVIRONMENT: Final = 0
"""Purpose of a draw: start states, transitions, observation noise."""
ACTION: Final = 1
"""Purpose of a draw: the policy's own choice."""

_MULTIPLIER_0 = np.uint64(0xD2511F53)
_MULTIPLIER_1 = np.uint64(0xCD9E8D57)
_WEYL_0 = np.uint64(0x9E3779B9)
_WEYL_1 = np.uint64(0xBB67AE85)
_LOW = np.uint64(0xFFFFFFFF)
_32 = np.uint64(32)


@njit(inline="always")  # a 32 x 32 -> 64 bit product and its halves stay in 64-bit lanes, which SIMD units have
def _rounds(c0, c1, c2, c3, k0, k1):
    for _ in range(10):
        p0 = _MULTIPLIER_0 * c0
        p1 = _MULTIPLIER_1 * c2
        c0, c1, c2, c3 = (p1 >> _32) ^ c1 ^ k0, p1 & _LOW, (p0 >> _32) ^ c3 ^ k1, p0 & _LOW
        k0 = (k0 + _WEYL_0) & _LOW
        k1 = (k1 + _WEYL_1) & _LOW
    return c0, c1, c2, c3


@on_demand()
def philox4x32(counters, keys, words):
    """Philox4x32-10 as published: row ``i`` of ``words`` (n, 4) from counter (n, 4) and key (n, 2), 32 bits each."""
    for i in range(counters.shape[0]):
        words[i, 0], words[i, 1], words[i, 2], words[i, 3] = _rounds(
            counters[i, 0], counters[i, 1], counters[i, 2], counters[i, 3], keys[i, 0], keys[i, 1]
        )


@on_demand()
def draw(key, episode, step, purpose, noise, lanes):
    """Fill the first ``lanes`` of ``noise`` (a multiple of 4 rows, LANES) with the uniforms in (0, 1) of their steps.

    The counter is (step, 4-row block and purpose, episode low, episode high), the key is 64 bits: no two draws of a
    run share both. A uniform is (word + 1/2) / 2^32, so neither 0 nor 1 ever comes up.
    """
    k0 = key & _LOW
    k1 = key >> _32
    for block in range(noise.shape[0] // 4):
        slot = np.uint64(2 * block + purpose)
        row = 4 * block
        for lane in range(lanes):
            e = episode[lane]
            w0, w1, w2, w3 = _rounds(np.uint64(step[lane]), slot, e & _LOW, e >> _32, k0, k1)
            noise[row, lane] = (np.float64(np.int64(w0)) + 0.5) * 2.0**-32
            noise[row + 1, lane] = (np.float64(np.int64(w1)) + 0.5) * 2.0**-32
            noise[row + 2, lane] = (np.float64(np.int64(w2)) + 0.5) * 2.0**-32
            noise[row + 3, lane] = (np.float64(np.int64(w3)) + 0.5) * 2.0**-32


def stream_key(seed: int, purpose: int = 0) -> int:
    """A 64-bit key for one purpose (training, evaluation, weights, ...) of one seed.

    Args:
        seed: Any non-negative integer below 2**64.
        purpose: Any integer in [0, 2**32).

    Raises:
        ValueError: If either is out of range.
    """
    if not 0 <= seed < 2**64:
        raise ValueError(f"seed must be in [0, 2**64), got {seed}")
    if not 0 <= purpose < 2**32:
        raise ValueError(f"purpose must be in [0, 2**32), got {purpose}")
    words = _words(purpose, seed)
    return int(words[0]) << 32 | int(words[1])


def episode_seeds(key: int, episodes: NDArray[np.uint64]) -> NDArray[np.int64]:
    """Seeds (n,) in [0, 2**31) for environments that bring their own generator: one for each episode's number."""
    counters = np.zeros((len(episodes), 4), np.uint64)
    counters[:, 2] = episodes & _LOW
    counters[:, 3] = episodes >> _32
    keys = np.tile(np.array([key & 0xFFFFFFFF, key >> 32], np.uint64), (len(episodes), 1))
    words = np.empty_like(counters)
    philox4x32(counters, keys, words)
    return (words[:, 0] >> np.uint64(1)).astype(np.int64)


def _words(counter: int, key: int) -> NDArray[np.uint64]:
    counters = np.array([[counter, 0, 0, 0]], np.uint64)
    words = np.empty_like(counters)
    philox4x32(counters, np.array([[key & 0xFFFFFFFF, key >> 32]], np.uint64), words)
    first: NDArray[np.uint64] = words[0]
    return first
