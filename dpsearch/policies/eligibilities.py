"""The output eligibilities of a softmax, with its entropy, in one compiled pass over all steps of a batch."""

from __future__ import annotations

import numpy as np
from numba import njit, types

from dpsearch.kernels.elementary import exp, log
from dpsearch.kernels.lanes import FASTMATH, INTS

_F32 = np.float32
_ROW = types.float32[::1]
_ROWS = types.float32[:, ::1]


_TYPES = types.void(INTS, _ROWS, _ROWS, _ROW, _ROW, _ROWS, _ROW)


@njit(_TYPES, cache=True, nogil=True, fastmath=FASTMATH, error_model="numpy")
def softmax_eligibilities(sizes, outputs, actions, weights, bonus, eligibilities, entropy):  # type: ignore[no-untyped-def]
    """``(a_i - p_i)`` times the step's weight, for each group of ``sizes[i]`` outputs (section 3.4.2).

    And the derivatives of the entropy, ``-p_i (log p_i + entropy)``, times the step's bonus.

    Args:
        sizes: ``(A,)``, choices of each group.
        outputs: ``(M, K)``, of M steps.
        actions: ``(M, A)``, whole numbers.
        weights: ``(M,)``.
        bonus: ``(M,)``, or ``(0,)`` for none.
        eligibilities: ``(K, M)``, written; the steps come last, so that the loops over them turn into SIMD.
        entropy: ``(M,)``, written: of all groups together, in nats.
    """
    n = len(weights)
    largest, total, mean = np.empty_like(weights), np.empty_like(weights), np.empty_like(weights)
    spread, of_entropy = np.empty_like(bonus), np.empty_like(bonus)
    entropy[:] = 0.0
    first = 0
    for i in range(len(sizes)):
        group = eligibilities[first : first + sizes[i]]
        for k in range(len(group)):
            for m in range(n):
                group[k, m] = outputs[m, first + k]
        largest[:] = group[0]
        for k in range(1, len(group)):
            for m in range(n):
                largest[m] = max(largest[m], group[k, m])
        total[:] = 0.0
        mean[:] = 0.0
        for k in range(len(group)):
            for m in range(n):
                logit = group[k, m] - largest[m]
                p = _F32(exp(logit))
                group[k, m] = p
                total[m] += p
                mean[m] += p * logit
        for m in range(n):
            mean[m] /= total[m]  # of the logits, so that log p - mean = log p + entropy
            entropy[m] += _F32(log(np.float64(total[m]))) - mean[m]
        for m in range(len(bonus)):
            spread[m] = bonus[m] / total[m]
        for m in range(n):
            total[m] = weights[m] / total[m]
        for k in range(len(group)):
            for m in range(len(bonus)):
                of_entropy[m] = group[k, m] * spread[m] * (outputs[m, first + k] - largest[m] - mean[m])
            for m in range(n):
                chosen = weights[m] if actions[m, i] == k else _F32(0.0)
                group[k, m] = chosen - group[k, m] * total[m]
            for m in range(len(bonus)):
                group[k, m] -= of_entropy[m]
        first += sizes[i]
