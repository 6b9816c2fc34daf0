"""The eligibilities of a softmax's outputs, alone or backpropagated through the layer below, in one compiled pass.

Steps are taken in blocks, in which they are the last axis, so that all loops turn into SIMD.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from dpsearch.kernels.activations import exp
from dpsearch.kernels.elementary import log
from dpsearch.kernels.lanes import FASTMATH
from dpsearch.kernels.on_demand import on_demand

BLOCK = 128
"""Steps in a block: so few that all numbers of the block stay in the processor's nearest cache."""
_F32 = np.float32
_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_WORKING_ROWS = 7  # that ``_weigh`` needs beside one for each output


@njit(inline="always")
def _weigh(sizes, outputs, first, count, actions, weights, bonus, working, entropy):
    """Replaces the outputs ``(K, BLOCK)`` of ``count`` steps, from step ``first`` on, by their eligibilities.

    In each group of ``sizes[i]`` outputs these are ``(a_i - p_i)`` times the step's weight (section 3.4.2), plus the
    derivatives of the entropy, ``-p_i (log p_i + entropy)``, times the step's bonus.
    """
    weight, extra, largest, total = working[0], working[1], working[2], working[3]
    mean, spread, taken = working[4], working[5], working[6]
    logits = working[_WORKING_ROWS:]
    for m in range(count):
        weight[m] = weights[first + m]
        extra[m] = bonus[first + m] if len(bonus) > 0 else _ZERO
        spread[m] = _ZERO
    row = 0
    for i in range(len(sizes)):
        group = outputs[row : row + sizes[i]]
        for m in range(count):
            taken[m] = actions[first + m, i]
            largest[m] = group[0, m]
            total[m] = _ZERO
            mean[m] = _ZERO
        for k in range(1, len(group)):
            for m in range(count):
                largest[m] = max(largest[m], group[k, m])
        for k in range(len(group)):
            for m in range(count):
                logit = group[k, m] - largest[m]
                p = exp(logit)
                logits[row + k, m] = logit
                group[k, m] = p
                total[m] += p
                mean[m] += p * logit
        for m in range(count):
            mean[m] /= total[m]  # of the logits, so that log p - mean = log p + entropy
            spread[m] += _F32(log(np.float64(total[m]))) - mean[m]
            total[m] = _ONE / total[m]
        for k in range(len(group)):
            for m in range(count):
                slope = weight[m] + extra[m] * (logits[row + k, m] - mean[m])
                chosen = weight[m] if taken[m] == k else _ZERO
                group[k, m] = chosen - group[k, m] * total[m] * slope
        row += sizes[i]
    for m in range(count):
        entropy[first + m] = spread[m]


@on_demand(fastmath=FASTMATH)
def softmax_eligibilities(sizes, outputs, actions, weights, bonus, eligibilities, entropy):
    """Derivatives of log pi(a|h) and of the entropy by the outputs, each with a factor, and added.

    All arrays but ``sizes`` (int64) are float32; all are C-contiguous.

    Args:
        sizes: ``(A,)``, choices of each group.
        outputs: ``(M, K)``, at M steps.
        actions: ``(M, A)``, whole numbers.
        weights: ``(M,)``, factors of the derivatives of log pi(a|h).
        bonus: ``(M,)``, factors of the derivatives of the entropy, or ``(0,)`` for none.
        eligibilities: ``(M, K)``, the sum, written.
        entropy: ``(M,)``, entropy of all groups together in nats, written.
    """
    n, size = outputs.shape
    block = np.empty((size, BLOCK), np.float32)
    working = np.empty((_WORKING_ROWS + size, BLOCK), np.float32)
    for first in range(0, n, BLOCK):
        count = min(BLOCK, n - first)
        for m in range(count):
            for k in range(size):
                block[k, m] = outputs[first + m, k]
        _weigh(sizes, block, first, count, actions, weights, bonus, working, entropy)
        for m in range(count):
            for k in range(size):
                eligibilities[first + m, k] = block[k, m]


@on_demand(fastmath=FASTMATH | {"reassoc"})  # sums over steps may be made in any order, else there is no SIMD
def softmax_gradient(sizes, weight, bias, features, actions, weights, bonus, by_features, by_weight, by_bias, entropy):
    """``softmax_eligibilities``, backpropagated through the linear layer that makes the outputs.

    All arrays but ``sizes`` (int64) are float32; all are C-contiguous.

    Args:
        sizes: ``(A,)``, choices of each group.
        weight: ``(K, H)``, weights of the layer.
        bias: ``(K,)``, bias of the layer.
        features: ``(T, B, H)``, input of the layer.
        actions: ``(T, B, A)``, whole numbers.
        weights: ``(T, B)``, factors of the derivatives of log pi(a|h).
        bonus: ``(T, B)``, factors of the derivatives of the entropy, or ``(0, 0)`` for none.
        by_features: ``(T, B, H)``, derivatives by the features, written.
        by_weight: ``(K, H)``, derivatives by the weights of the layer, summed over steps, written.
        by_bias: ``(K,)``, derivatives by the bias of the layer, summed over steps, written.
        entropy: ``(T, B)``, entropy of all groups together in nats, written.
    """
    n, size = weights.size, len(weight[0])
    features, by_features, actions = (
        features.reshape(n, size),
        by_features.reshape(n, size),
        actions.reshape(n, len(sizes)),
    )
    weights, bonus, entropy = weights.reshape(n), bonus.reshape(bonus.size), entropy.reshape(n)
    seen = np.empty((size, BLOCK), np.float32)
    outputs = np.empty((len(bias), BLOCK), np.float32)
    working = np.empty((_WORKING_ROWS + len(bias), BLOCK), np.float32)
    by_weight[:] = _ZERO
    by_bias[:] = _ZERO
    for first in range(0, n, BLOCK):
        count = min(BLOCK, n - first)
        for m in range(count):
            for h in range(size):
                seen[h, m] = features[first + m, h]
        for k in range(len(bias)):
            for m in range(count):
                outputs[k, m] = bias[k]
            for h in range(size):
                for m in range(count):
                    outputs[k, m] += weight[k, h] * seen[h, m]
        _weigh(sizes, outputs, first, count, actions, weights, bonus, working, entropy)
        for k in range(len(bias)):
            total = _ZERO
            for m in range(count):
                total += outputs[k, m]
            by_bias[k] += total
            for h in range(size):
                total = _ZERO
                for m in range(count):
                    total += outputs[k, m] * seen[h, m]
                by_weight[k, h] += total
        for h in range(size):
            for m in range(count):
                seen[h, m] = weight[0, h] * outputs[0, m]  # which is not needed any more
            for k in range(1, len(bias)):
                for m in range(count):
                    seen[h, m] += weight[k, h] * outputs[k, m]
        for m in range(count):
            for h in range(size):
                by_features[first + m, h] = seen[h, m]
