"""The forward pass and the sampling of policies, compiled for lanes: what lets an engine play millions of steps.

Each function is the twin of a torch module (``recurrent.py``, ``heads.py``) and agrees with it to rounding. Weights
come flat, in the order of ``RecurrentPolicy.vector()``: input weights, recurrent weights, biases, head weights, head
biases, each row-major. They are ``(P,)``, one policy in all lanes, or ``(P, LANES)``, a candidate in each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dpsearch.kernels.affine import affine
from dpsearch.kernels.elementary import exp, log, sigmoid, sincos, tanh
from dpsearch.kernels.lanes import FASTMATH, FORWARD_LANES, FORWARD_SHARED, LANES, SAMPLE, Compiled
from dpsearch.policies.heads import Categorical, Deterministic, Gaussian, Head

_FORWARD = [FORWARD_SHARED, FORWARD_LANES]


@dataclass(frozen=True)
class CompiledPolicy:
    """A policy's compiled functions and the sizes they work with.

    Attributes:
        forward: Signatures ``FORWARD_SHARED`` and ``FORWARD_LANES``.
        sample: Signature ``SAMPLE``: a random action.
        mode: Signature ``SAMPLE``: the greedy action.
        sizes: Observation size, hidden size, outputs, and 1 if there are biases: ``(4,)`` int64.
        head_sizes: What ``sample`` needs to know of the outputs' layout.
        hidden_rows: Rows of recurrent state, zero at the start of an episode.
        scratch_rows: Rows of working memory.
        n_outputs: Rows of output.
        action_size: Rows of action.
        draws: Uniform numbers an action needs.
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


@njit(inline="always")
def _read_out(sizes, weights, offset, features, one, output):  # type: ignore[no-untyped-def]
    output[:] = 0.0
    affine(weights, offset, sizes[2], sizes[1], features, output)
    if sizes[3] == 1:
        affine(weights, offset + sizes[2] * sizes[1], sizes[2], 1, one, output)


@njit(_FORWARD, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def lstm(sizes, weights, observation, hidden, scratch, output):  # type: ignore[no-untyped-def]
    """``torch.nn.LSTM`` and a linear layer; ``hidden`` holds the outputs h above the cells c."""
    inputs, n = sizes[0], sizes[1]
    one, gates = scratch[:1], scratch[1:]
    one[:] = 1.0
    gates[:] = 0.0
    affine(weights, 0, 4 * n, inputs, observation, gates)
    affine(weights, 4 * n * inputs, 4 * n, n, hidden, gates)
    offset = 4 * n * (inputs + n)
    if sizes[3] == 1:
        affine(weights, offset, 4 * n, 1, one, gates)
        offset += 4 * n
    for j in range(n):
        for lane in range(LANES):  # gates in torch's order: input, forget, cell, output
            cell = sigmoid(gates[n + j, lane]) * hidden[n + j, lane]
            cell += sigmoid(gates[j, lane]) * tanh(gates[2 * n + j, lane])
            hidden[n + j, lane] = cell
            hidden[j, lane] = sigmoid(gates[3 * n + j, lane]) * tanh(cell)
    _read_out(sizes, weights, offset, hidden, one, output)


@njit(_FORWARD, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def elman(sizes, weights, observation, hidden, scratch, output):  # type: ignore[no-untyped-def]
    """``torch.nn.RNN`` with tanh and a linear layer."""
    inputs, n = sizes[0], sizes[1]
    one, net = scratch[:1], scratch[1:]
    one[:] = 1.0
    net[:] = 0.0
    affine(weights, 0, n, inputs, observation, net)
    affine(weights, n * inputs, n, n, hidden, net)
    offset = n * (inputs + n)
    if sizes[3] == 1:
        affine(weights, offset, n, 1, one, net)
        offset += n
    for j in range(n):
        for lane in range(LANES):
            hidden[j, lane] = tanh(net[j, lane])
    _read_out(sizes, weights, offset, hidden, one, output)


@njit(_FORWARD, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def memoryless(sizes, weights, observation, hidden, scratch, output):  # type: ignore[no-untyped-def]
    """One tanh layer and a linear layer: reacts to the present observation alone."""
    inputs, n = sizes[0], sizes[1]
    one, net = scratch[:1], scratch[1:]
    one[:] = 1.0
    net[:] = 0.0
    affine(weights, 0, n, inputs, observation, net)
    offset = n * inputs
    if sizes[3] == 1:
        affine(weights, offset, n, 1, one, net)
        offset += n
    for j in range(n):
        for lane in range(LANES):
            net[j, lane] = tanh(net[j, lane])
    _read_out(sizes, weights, offset, net, one, output)


@njit(SAMPLE, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def categorical_sample(sizes, noise, output, action):  # type: ignore[no-untyped-def]
    """Inverts the cumulative softmax of each group of ``sizes[i]`` outputs. Overwrites ``output``."""
    first = 0
    for i in range(sizes.shape[0]):
        last = first + sizes[i] - 1
        action[i] = output[first]  # the largest logit, for now
        for row in range(first + 1, last + 1):
            for lane in range(LANES):
                action[i, lane] = max(action[i, lane], output[row, lane])
        for lane in range(LANES):
            output[first, lane] = exp(output[first, lane] - action[i, lane])
        for row in range(first + 1, last + 1):
            for lane in range(LANES):
                output[row, lane] = output[row - 1, lane] + exp(output[row, lane] - action[i, lane])
        for lane in range(LANES):
            action[i, lane] = 0.0
        for row in range(first, last):
            for lane in range(LANES):
                action[i, lane] += 1.0 if output[row, lane] <= noise[i, lane] * output[last, lane] else 0.0
        first = last + 1


@njit(SAMPLE, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def categorical_mode(sizes, noise, output, action):  # type: ignore[no-untyped-def]
    """The first largest output of each group."""
    first = 0
    for i in range(sizes.shape[0]):
        for lane in range(LANES):
            best = 0
            for choice in range(1, sizes[i]):
                if output[first + choice, lane] > output[first + best, lane]:
                    best = choice
            action[i, lane] = best
        first += sizes[i]


@njit(SAMPLE, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def gaussian_sample(sizes, noise, output, action):  # type: ignore[no-untyped-def]
    """Box and Muller around the linear mean, with the sigmoid standard deviation."""
    n = sizes[0]
    for i in range(n):
        for lane in range(LANES):
            radius = np.sqrt(-2.0 * log(noise[2 * i, lane]))
            _, cosine = sincos(2.0 * np.pi * noise[2 * i + 1, lane])
            action[i, lane] = output[i, lane] + sigmoid(output[n + i, lane]) * radius * cosine


@njit(SAMPLE, cache=True, nogil=True, error_model="numpy")
def gaussian_mode(sizes, noise, output, action):  # type: ignore[no-untyped-def]
    """The mean."""
    action[:] = output[: sizes[0]]


@njit(SAMPLE, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def deterministic(sizes, noise, output, action):  # type: ignore[no-untyped-def]
    """The outputs, squashed."""
    for i in range(sizes[0]):
        for lane in range(LANES):
            action[i, lane] = tanh(output[i, lane])


def compiled_policy(
    core: str, observation_size: int, hidden_size: int, head: Head, bias: bool
) -> CompiledPolicy:
    """The compiled twin of a ``RecurrentPolicy`` with these sizes."""
    forward, hidden_rows, scratch_rows = {
        "lstm": (lstm, 2 * hidden_size, 1 + 4 * hidden_size),
        "rnn": (elman, hidden_size, 1 + hidden_size),
        "none": (memoryless, 0, 1 + hidden_size),
    }[core]
    match head:
        case Categorical():
            sample, mode, head_sizes = categorical_sample, categorical_mode, head.sizes
        case Gaussian():
            sample, mode, head_sizes = gaussian_sample, gaussian_mode, (head.size,)
        case Deterministic():
            sample, mode, head_sizes = deterministic, deterministic, (head.action_size,)
        case _:
            raise TypeError(f"no compiled sampling for a {type(head).__name__} head")
    return CompiledPolicy(
        forward=forward,
        sample=sample,
        mode=mode,
        sizes=np.array([observation_size, hidden_size, head.n_outputs, bias], np.int64),
        head_sizes=np.array(head_sizes, np.int64),
        hidden_rows=hidden_rows,
        scratch_rows=scratch_rows,
        n_outputs=head.n_outputs,
        action_size=head.action_size,
        draws=head.draws,
    )
