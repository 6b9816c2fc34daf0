"""The compiled twin of a policy: its functions, its sizes, and the order in which they read its weights.

The functions themselves stand beside their torch twins, in ``cores/`` and ``heads/``, and agree with them to rounding.
Weights come packed (``CompiledPolicy.pack``): the matrices of the core, then that of the read-out, with the biases as
their last columns. They are ``(P,)``, one policy in all lanes, or ``(P, LANES)``, a candidate in each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpsearch.kernels.lanes import LANES, Compiled
from dpsearch.kernels.on_demand import on_demand
from dpsearch.policies.cores import Core
from dpsearch.policies.cores.stacking import ECHO, NOISE, ONE_HOT, OUTPUTS
from dpsearch.policies.heads import Head


@dataclass(frozen=True, eq=False)
class CompiledPolicy:
    """A policy's compiled functions and the sizes they work with.

    Attributes:
        forward: Step of the core with the read-out. Signatures ``FORWARD_SHARED``, ``FORWARD_LANES``,
            ``FORWARD_SINGLE``.
        sample: Picks a random action. Signature ``SAMPLE``.
        mode: Picks the greedy action. Signature ``SAMPLE``.
        sizes: Sizes that ``forward`` needs, at the places that ``cores/stacking.py`` names, ``(7,)`` int64.
        head_sizes: Sizes that ``sample`` and ``mode`` need, int64.
        hidden_rows: Rows of recurrent state, zero at the start of an episode; the last are those of the noise that
            lasts and then those of the previous action.
        scratch_rows: Rows of working memory.
        n_outputs: Rows of output; the last are the part of the previous step's noise that is left.
        action_size: Rows of action.
        draws: Uniform numbers that an action needs.
        constants: 0, 1 and the part of the noise that is left after a step, which no parameter holds, ``(3,)``.
        order: Place of each packed weight in ``RecurrentPolicy.vector()`` with the constants behind it.
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
        """Put weights in the order that ``forward`` reads them, and in the precision that they are played in.

        One policy whose actions are random is played in float32, the precision it is trained in, twice as fast.
        Candidates, and policies whose actions are not random, are played in float64: whether a pole stays up for
        100,000 steps can depend on the last digit, and a candidate that was found to do it must do it again as the
        policy it becomes.

        Args:
            weights: ``(P,)`` of one policy, or ``(N, P)`` of N candidates, in the layout of
                ``RecurrentPolicy.vector()``.
            greedy: Whether the policy takes its greedy actions.
        """
        random = self.draws > 0 and not greedy
        constants = np.broadcast_to(self.constants, (*weights.shape[:-1], 3)) if weights.ndim > 1 else self.constants
        packed = np.concatenate(
            (weights, constants), axis=-1, dtype=np.float32 if random and weights.ndim == 1 else np.float64
        )
        return packed.take(self.order, axis=-1)


def compile_policy(
    core: Core, head: Head, observation_size: int, *, readout: bool, previous_action: bool, noise_memory: float
) -> CompiledPolicy:
    """Describe the compiled twin of a policy. Its functions are compiled when they are needed.

    Args:
        core: The policy's core.
        head: The policy's head.
        observation_size: Length of a flat observation.
        readout: Whether the policy has a read-out of its own.
        previous_action: Whether the policy sees its previous action.
        noise_memory: Part of the action noise that is left in the next action.
    """
    n, bias = core.units, core.bias is not None
    echo, noise = head.echo_size if previous_action else 0, head.action_size if noise_memory else 0
    outputs = head.n_outputs + noise
    sizes = (observation_size, n, outputs, bias, echo, head.one_hot, noise)
    return CompiledPolicy(
        forward=core.step,
        sample=head.compiled_sample,
        mode=head.compiled_mode,
        sizes=np.array(sizes, np.int64),
        head_sizes=np.array(head.layout, np.int64),
        hidden_rows=core.state_size + noise + echo,
        scratch_rows=observation_size + echo + noise + n + 1 + core.workspace * n,
        n_outputs=outputs,
        action_size=head.action_size,
        draws=head.draws,
        constants=np.array([0.0, 1.0, noise_memory]),
        order=_order(core, head.n_outputs, readout, noise),
    )


def _order(core: Core, outputs: int, has_readout: bool, noise: int) -> NDArray[np.intp]:
    """Places in a policy's flat vector, and in the constants behind it, in the order that ``forward`` reads them.

    Without a read-out, its matrix is the identity and its bias 0, made of the constants. With noise that lasts, the
    read-out has columns for it, which add to the means the part that is left, and rows that give just that part.
    """
    n, biases, first = core.units, int(core.bias is not None), sum(part.size for part in core.places().values())
    if has_readout:
        weight, zero = first + np.arange(outputs * n).reshape(outputs, n), first + outputs * (n + biases)
        readout = np.hstack([weight, np.arange(first + outputs * n, zero).reshape(outputs, biases)])
    else:
        zero, readout = first, first + np.eye(outputs, n + biases, dtype=np.intp)
    if noise:
        rows, memory = np.arange(noise), zero + 2
        left = np.full((outputs + noise, noise), zero)
        left[rows, rows] = left[outputs + rows, rows] = memory
        last = np.pad(readout, ((0, noise), (0, 0)), constant_values=zero)
        readout = np.hstack([last[:, :n], left, last[:, n:]])
    return np.concatenate([*core.packed(), readout], axis=None)


@on_demand()
def remember_action(sizes, head_sizes, output, action, hidden):
    """Puts the action taken, and the noise in it, into the last rows of the recurrent state, if the policy has them."""
    first = hidden.shape[0] - sizes[ECHO]
    for i in range(sizes[NOISE]):  # distance of the action from the mean that the network alone would give
        for lane in range(LANES):
            left = output[sizes[OUTPUTS] - sizes[NOISE] + i, lane]
            hidden[first - sizes[NOISE] + i, lane] = action[i, lane] - output[i, lane] + left
    for i in range(action.shape[0] if sizes[ECHO] > 0 else 0):
        if sizes[ONE_HOT] == 0:
            hidden[first + i] = action[i]
        else:
            for choice in range(head_sizes[i]):
                for lane in range(LANES):
                    hidden[first + choice, lane] = 1.0 if action[i, lane] == choice else 0.0
            first += head_sizes[i]
