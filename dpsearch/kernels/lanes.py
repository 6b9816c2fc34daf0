"""The layout every kernel shares: episodes run in lanes, stepped in lock-step, the lane as the last axis.

An array of lane values is ``(rows, LANES)`` and C-contiguous, so that one row is one run of memory and LLVM turns a
loop over its lanes into SIMD. A kernel is a handful of compiled functions with the signatures below. They are passed
around as the addresses of first-class functions of explicit type, because that is the one way of composing Numba
functions whose result is found again in the on-disk cache; the indirect call costs nothing when it covers a whole block
of lanes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.types.function_type import CompileResultWAP
from numba.extending import intrinsic
from numpy.typing import NDArray

LANES = 24
"""Episodes in a block: three AVX-512 registers of doubles, to hide latency, and little waste with batches of 20."""

WIDTH = 8
"""Kernels compute the first lanes of a block, a multiple of so many: with few episodes left, the others are skipped."""

FASTMATH = {"contract", "nsz", "arcp"}
"""Freedom for the compiler that keeps infinities and NaN meaningful and never reorders a sum."""

FLOATS = types.float64[::1]
INTS = types.int64[::1]
ROWS = types.float64[:, ::1]
SINGLES = types.float32[::1]
SINGLE_ROWS = types.float32[:, ::1]

RESET = types.void(FLOATS, INTS, ROWS, types.int64, ROWS)
"""``reset(floats, ints, noise, lane, state)``: puts one lane of ``state`` at the start of an episode."""

OBSERVE = types.void(FLOATS, INTS, ROWS, ROWS, types.int64)
"""``observe(floats, ints, state, observation, lanes)``: writes what each of the first lanes sees now."""

STEP = types.void(FLOATS, INTS, ROWS, ROWS, ROWS, FLOATS, types.boolean[::1], types.int64)
"""``step(floats, ints, noise, action, state, reward, terminated, lanes)``: moves the first lanes one step on."""

FORWARD_SHARED = types.void(INTS, FLOATS, ROWS, ROWS, ROWS, ROWS, types.int64)
"""``forward(sizes, weights, observation, hidden, scratch, output, lanes)`` with one weight vector ``(P,)`` for all."""

FORWARD_LANES = types.void(INTS, ROWS, ROWS, ROWS, ROWS, ROWS, types.int64)
"""``forward`` with weights ``(P, LANES)``: every lane plays its own candidate."""

FORWARD_SINGLE = types.void(INTS, SINGLES, ROWS, SINGLE_ROWS, SINGLE_ROWS, ROWS, types.int64)
"""``FORWARD_SHARED`` in single precision: weights, hidden state and scratch are float32."""

SAMPLE = types.void(INTS, ROWS, ROWS, ROWS, types.int64)
"""``sample(sizes, noise, output, action, lanes)``: turns the outputs of a policy into actions.

Only the actions of the first lanes are valid.
"""

Compiled = Callable[..., Any]


@dataclass(frozen=True)
class EnvKernel:
    """The compiled dynamics of an environment, which the lane engine and the Gymnasium classes play.

    Attributes:
        reset: Compiled function of signature ``RESET``.
        observe: Compiled function of signature ``OBSERVE``.
        step: Compiled function of signature ``STEP``. It must be safe on lanes whose episode has ended.
        floats: Real parameters of the three functions, ``(n,)`` float64.
        ints: Integer parameters of the three functions, ``(m,)`` int64.
        state_size: Rows of ``state``, which holds all of an episode's memory: kernels are pure functions.
        observation_size: Rows of ``observation``, the length of the flat observation.
        action_size: Rows of ``action``: 1 for a discrete action, the dimension for a continuous one.
        draws: Uniform numbers in (0, 1) that ``reset`` and ``step`` each find in a lane's column of ``noise``, which
            has ``noise_rows(draws)`` rows.
    """

    reset: Compiled
    observe: Compiled
    step: Compiled
    floats: NDArray[np.float64]
    ints: NDArray[np.int64]
    state_size: int
    observation_size: int
    action_size: int = 1
    draws: int = 4


@cache
def address_of(function: Compiled, signature: Any) -> int:
    """Address of a compiled function, for ``function_at``; it stays valid, for the cache keeps the function alive."""
    compiled = function.get_compile_result(signature)  # type: ignore[attr-defined]
    address: int = CompileResultWAP(compiled).__wrapper_address__()
    return address


def function_at(signature: Any) -> Compiled:
    """A compiled function that turns an address into the first-class function of this signature.

    Compiled code takes first-class functions as arguments too, but to unpack five of them takes Numba as long as to
    play a small batch of episodes; unpacking numbers takes next to nothing.
    """
    function_type = types.FunctionType(signature)

    @intrinsic
    def at(typing_context: Any, address: Any) -> Any:
        def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            function = cgutils.create_struct_proxy(function_type)(context, builder)
            function.c_addr = builder.inttoptr(args[0], cgutils.voidptr_t)
            return function._getvalue()

        return function_type(types.int64), codegen

    return at  # type: ignore[no-any-return]


def lanes_in_use(episodes: int) -> int:
    """Number of lanes that kernels must compute for so many episodes in a block: a multiple of ``WIDTH``."""
    return min(WIDTH * -(-episodes // WIDTH), LANES)


def noise_rows(draws: int) -> int:
    """Rows that a noise array needs for ``draws`` numbers a lane: the generator makes them four at a time."""
    return 4 * -(-draws // 4)


@intrinsic
def fetch_add(typing_context: Any, counter: Any) -> Any:
    """Return ``counter[0]`` and add one to it, atomically: how threads share one queue of episodes."""
    signature = types.int64(INTS)

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        pointer = context.make_array(signature.args[0])(context, builder, args[0]).data
        return builder.atomic_rmw("add", pointer, ir.Constant(ir.IntType(64), 1), "monotonic")

    return signature, codegen
