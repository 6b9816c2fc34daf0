"""The forward pass and the sampling of policies, compiled for lanes: what lets an engine play millions of steps.

Each function is the twin of a torch module (``recurrent.py``, ``heads.py``) and agrees with it to rounding. Weights
come packed (``CompiledPolicy.pack``): the core's matrix, whose rows are a unit's input weights, recurrent weights and
bias, so that one product with (observation, hidden, 1) does it all; then the read-out's, likewise. They are ``(P,)``,
one policy in all lanes, or ``(P, LANES)``, a candidate in each.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numba import njit, types
from numpy.typing import NDArray

from dpsearch.kernels.activations import sigmoid, tanh
from dpsearch.kernels.elementary import exp, log, sincos
from dpsearch.kernels.lanes import (
    FASTMATH,
    FORWARD_LANES,
    FORWARD_SHARED,
    FORWARD_SINGLE,
    INTS,
    LANES,
    ROWS,
    SAMPLE,
    SINGLE_ROWS,
    Compiled,
)
from dpsearch.kernels.matvec import matvec
from dpsearch.policies.heads import Categorical, Deterministic, Gaussian, Head

_FORWARD = [FORWARD_SHARED, FORWARD_LANES, FORWARD_SINGLE]


@dataclass(frozen=True, eq=False)
class CompiledPolicy:
    """A policy's compiled functions and the sizes they work with.

    Attributes:
        forward: Signatures ``FORWARD_SHARED``, ``FORWARD_LANES`` and ``FORWARD_SINGLE``.
        sample: Signature ``SAMPLE``: a random action.
        mode: Signature ``SAMPLE``: the greedy action.
        sizes: Observation size, hidden size, outputs, 1 if there are biases, rows of the previous action among the
            inputs, 1 if these are one-hot, and rows of noise carried over: ``(7,)`` int64.
        head_sizes: What ``sample`` needs to know of the outputs' layout.
        hidden_rows: Rows of recurrent state, zero at the start of an episode; the last are those of the noise carried
            over and then the previous action's.
        scratch_rows: Rows of working memory.
        n_outputs: Rows of output; the last are what is left of the noise of the step before.
        action_size: Rows of action.
        draws: Uniform numbers an action needs.
        constants: 0, 1 and what part of the noise is left after a step, which no parameter holds, ``(3,)``.
        order: Where each packed weight stands in ``RecurrentPolicy.vector()`` with the constants behind it.
    """

    forward: Compiled
    sample: Compiled
    mode: Compiled
    sizes: NDArray[np.int64]
    head_sizes: NDArray[np.int64]
    hidden_rows: int
    scratch_rows: int
    n_outputs: int
    action_size: int
    draws: int
    constants: NDArray[np.float64]
    order: NDArray[np.intp]

    def pack(self, weights: NDArray[np.float64], greedy: bool) -> NDArray[Any]:
        """Weights ``(.., P)`` of ``RecurrentPolicy.vector()``'s layout, in the order that ``forward`` reads them.

        Those of one policy ``(P,)`` whose actions are random are float32: what it is trained in, and twice as fast. Of
        candidates, and where actions are not random, they are float64: whether a pole stays up for 100,000 steps can
        depend on the last digit, and a candidate that was found to do it must do it again as the policy it becomes.
        """
        random = self.draws > 0 and not greedy
        constants = np.broadcast_to(self.constants, (*weights.shape[:-1], 3)) if weights.ndim > 1 else self.constants
        packed = np.concatenate(
            (weights, constants), axis=-1, dtype=np.float32 if random and weights.ndim == 1 else np.float64
        )
        return packed.take(self.order, axis=-1)


@njit(inline="always")
def _put(rows, count, stacked, first):
    """Copies the first rows of something to where ``first`` says; returns the row behind them."""
    for i in range(count):
        for lane in range(LANES):
            stacked[first + i, lane] = rows[i, lane]
    return first + count


@njit(inline="always")
def _inputs(sizes, observation, previous, memory, n_memory, stacked):
    """(observation, previous action, memory, 1), or without the 1, and how many rows that is."""
    columns = _put(observation, sizes[0], stacked, 0)
    columns = _put(previous, sizes[4], stacked, columns)
    return _end(memory, n_memory, sizes[3], stacked, columns)


@njit(inline="always")
def _features(sizes, memory, noise, stacked):
    """(memory, noise, 1), or without the 1: what the read-out reads. Returns how many rows that is."""
    columns = _put(memory, sizes[1], stacked, 0)
    return _end(noise, sizes[6], sizes[3], stacked, columns)


@njit(inline="always")
def _end(rows, count, bias, stacked, first):
    """(rows, 1), or without the 1, below what is there already."""
    columns = _put(rows, count, stacked, first)
    for lane in range(LANES):
        stacked[columns, lane] = 1.0
    return columns + bias


@njit(_FORWARD, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def lstm(sizes, weights, observation, hidden, scratch, output, lanes):
    """``torch.nn.LSTM`` and a linear layer; ``hidden`` holds the outputs h above the cells c."""
    n, outputs, rows, noise = sizes[1], sizes[2], sizes[0] + sizes[4] + sizes[6] + sizes[1] + 1, hidden[2 * sizes[1] :]
    seen, gates, units = scratch[:rows], scratch[rows:].reshape(-1), n * lanes
    columns = _inputs(sizes, observation, noise[sizes[6] :], hidden, n, seen)
    matvec(weights, 0, 4 * n, columns, seen, gates, lanes)  # units without gaps: long loops, which is what SIMD likes
    enter, keep, new, leave = gates[:units], gates[units:], gates[2 * units :], gates[3 * units :]  # in torch's order
    for k in range(units):
        new[k] = sigmoid(enter[k]) * tanh(new[k])
    for k in range(units):
        keep[k] = sigmoid(keep[k])
    for j in range(n):
        cell, kept, added = hidden[n + j], keep[j * lanes :], new[j * lanes :]
        for lane in range(lanes):
            added[lane] = kept[lane] * cell[lane] + added[lane]
        for lane in range(lanes):  # assigning slices takes several times as long
            cell[lane] = added[lane]
    for k in range(units):
        leave[k] = sigmoid(leave[k]) * tanh(new[k])
    for j in range(n):
        memory, left = hidden[j], leave[j * lanes :]
        for lane in range(lanes):
            memory[lane] = left[lane]
    first = 4 * n * columns
    matvec(weights, first, outputs, _features(sizes, hidden, noise, seen), seen, output, lanes)


@njit(_FORWARD, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def elman(sizes, weights, observation, hidden, scratch, output, lanes):
    """``torch.nn.RNN`` with tanh and a linear layer."""
    n, outputs, noise = sizes[1], sizes[2], hidden[sizes[1] :]
    columns = _inputs(sizes, observation, noise[sizes[6] :], hidden, n, scratch)
    matvec(weights, 0, n, columns, scratch, hidden, lanes)
    for j in range(n):
        for lane in range(lanes):
            hidden[j, lane] = tanh(hidden[j, lane])
    first = n * columns
    matvec(weights, first, outputs, _features(sizes, hidden, noise, scratch), scratch, output, lanes)


@njit(_FORWARD, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def memoryless(sizes, weights, observation, hidden, scratch, output, lanes):
    """One tanh layer and a linear layer: reacts to the present observation alone, or that and the previous action."""
    n, outputs, rows = sizes[1], sizes[2], sizes[0] + sizes[4] + sizes[6] + sizes[1] + 1
    seen, units = scratch[:rows], scratch[rows:]
    columns = _inputs(sizes, observation, hidden[sizes[6] :], hidden, 0, seen)
    matvec(weights, 0, n, columns, seen, units, lanes)
    for j in range(n):
        for lane in range(lanes):
            units[j, lane] = tanh(units[j, lane])
    first = n * columns
    matvec(weights, first, outputs, _features(sizes, units, hidden, seen), seen, output, lanes)


@njit(
    [types.void(INTS, INTS, ROWS, ROWS, hidden) for hidden in (ROWS, SINGLE_ROWS)],
    cache=True,
    nogil=True,
    error_model="numpy",
)
def remember_action(sizes, head_sizes, output, action, hidden):
    """Puts the action taken, and the noise in it, into the last rows of the recurrent state, for who needs them."""
    first = hidden.shape[0] - sizes[4]
    for i in range(sizes[6]):  # how far from where the network alone would have had the mean
        for lane in range(LANES):
            left = output[sizes[2] - sizes[6] + i, lane]
            hidden[first - sizes[6] + i, lane] = action[i, lane] - output[i, lane] + left
    for i in range(action.shape[0] if sizes[4] > 0 else 0):
        if sizes[5] == 0:
            hidden[first + i] = action[i]
        else:
            for choice in range(head_sizes[i]):
                for lane in range(LANES):
                    hidden[first + choice, lane] = 1.0 if action[i, lane] == choice else 0.0
            first += head_sizes[i]


@njit(SAMPLE, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def categorical_sample(sizes, noise, output, action, lanes):
    """Inverts the cumulative softmax of each group of ``sizes[i]`` outputs. Overwrites ``output``."""
    first = 0
    for i in range(sizes.shape[0]):
        last = first + sizes[i] - 1
        action[i] = output[first]  # the largest logit, for now
        for row in range(first + 1, last + 1):
            for lane in range(lanes):
                action[i, lane] = max(action[i, lane], output[row, lane])
        for lane in range(lanes):
            output[first, lane] = exp(output[first, lane] - action[i, lane])
        for row in range(first + 1, last + 1):
            for lane in range(lanes):
                output[row, lane] = output[row - 1, lane] + exp(output[row, lane] - action[i, lane])
        for lane in range(lanes):
            action[i, lane] = 0.0
        for row in range(first, last):
            for lane in range(lanes):
                action[i, lane] += 1.0 if output[row, lane] <= noise[i, lane] * output[last, lane] else 0.0
        first = last + 1


@njit(SAMPLE, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def categorical_mode(sizes, noise, output, action, lanes):
    """The first largest output of each group."""
    first = 0
    for i in range(sizes.shape[0]):
        for lane in range(lanes):
            best = 0
            for choice in range(1, sizes[i]):
                if output[first + choice, lane] > output[first + best, lane]:
                    best = choice
            action[i, lane] = best
        first += sizes[i]


@njit(SAMPLE, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def gaussian_sample(sizes, noise, output, action, lanes):
    """Box and Muller around the linear mean, with the sigmoid standard deviation."""
    n = sizes[0]
    for i in range(n):
        for lane in range(lanes):
            radius = np.sqrt(-2.0 * log(noise[2 * i, lane]))
            _, cosine = sincos(2.0 * np.pi * noise[2 * i + 1, lane])
            action[i, lane] = output[i, lane] + sigmoid(output[n + i, lane]) * radius * cosine


@njit(SAMPLE, cache=True, nogil=True, error_model="numpy")
def gaussian_mode(sizes, noise, output, action, lanes):
    """The mean."""
    action[:] = output[: sizes[0]]


@njit(SAMPLE, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def deterministic(sizes, noise, output, action, lanes):
    """The outputs, squashed."""
    for i in range(sizes[0]):
        for lane in range(lanes):
            action[i, lane] = tanh(output[i, lane])


@njit(SAMPLE, cache=True, nogil=True, error_model="numpy")
def unsquashed(sizes, noise, output, action, lanes):
    """The outputs as they are."""
    action[:] = output[: sizes[0]]


@cache
def compiled_policy(
    core: str,
    observation_size: int,
    hidden_size: int,
    head: Head,
    bias: bool,
    readout: bool = True,
    previous_action: bool = False,
    noise_memory: float = 0.0,
) -> CompiledPolicy:
    """The compiled twin of a ``RecurrentPolicy`` with these sizes."""
    n, echo, noise = hidden_size, head.echo_size if previous_action else 0, head.action_size if noise_memory else 0
    inputs = observation_size + echo
    forward, units, recurrent, hidden_rows, work_rows = {
        "lstm": (lstm, 4 * n, n, 2 * n, 4 * n),
        "rnn": (elman, n, n, n, 0),
        "none": (memoryless, n, 0, 0, n),
    }[core]
    match head:
        case Categorical():
            sample, mode, head_sizes = categorical_sample, categorical_mode, head.sizes
        case Gaussian():
            sample, mode, head_sizes = gaussian_sample, gaussian_mode, (head.size,)
        case Deterministic():
            squashed = deterministic if head.squash else unsquashed
            sample, mode, head_sizes = squashed, squashed, (head.action_size,)
        case _:
            raise TypeError(f"no compiled sampling for a {type(head).__name__} head")
    return CompiledPolicy(
        forward=forward,
        sample=sample,
        mode=mode,
        sizes=np.array(
            [observation_size, n, head.n_outputs + noise, bias, echo, isinstance(head, Categorical), noise], np.int64
        ),
        head_sizes=np.array(head_sizes, np.int64),
        hidden_rows=hidden_rows + noise + echo,
        scratch_rows=inputs + noise + n + 1 + work_rows,
        n_outputs=head.n_outputs + noise,
        action_size=head.action_size,
        draws=head.draws,
        constants=np.array([0.0, 1.0, noise_memory]),
        order=_order(
            [(units, inputs), (units, recurrent), (units, int(bias))],
            [(head.n_outputs, n), (head.n_outputs, int(bias))],
            readout,
            noise,
        ),
    )


def _order(
    core: list[tuple[int, int]], readout: list[tuple[int, int]], has_readout: bool, noise: int
) -> NDArray[np.intp]:
    """Positions in a flat vector of matrices of these shapes, read with each layer's matrices side by side.

    Without a read-out its matrix is the identity and its bias 0, made of the constants that follow the vector. With
    noise carried over the read-out has columns for it, which add what is left of it to the means, and rows that give
    just that.
    """
    order, first = [], 0
    for layer in (core, readout) if has_readout else (core,):
        blocks = []
        for rows, columns in layer:
            blocks.append(np.arange(first, first + rows * columns).reshape(rows, columns))
            first += rows * columns
        order.append(np.hstack(blocks))
    zero, memory = first, first + 2
    (outputs, n), (_, biases) = readout
    if not has_readout:
        order.append(zero + np.eye(outputs, n + biases, dtype=np.intp))
    if noise:
        left = np.full((outputs + noise, noise), zero)
        left[np.arange(noise), np.arange(noise)] = left[outputs + np.arange(noise), np.arange(noise)] = memory
        last = np.pad(order[1], ((0, noise), (0, 0)), constant_values=zero)
        order[1] = np.hstack([last[:, :n], left, last[:, n:]])
    return np.concatenate(order, axis=None)
