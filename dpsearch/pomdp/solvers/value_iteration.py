"""Value iteration (Bellman, 1957): the optimum of a task whose hidden state is seen.

It is an upper bound for agents that see only the symbols, and the basis of QMDP and similar policies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.solvers.agents import Controller, Floats, Ints

_EQUAL = 1e-9  # action values no further apart count as equal
_MOST_SWEEPS = 100_000


@dataclass(frozen=True, eq=False)
class Solution:
    """The optimum of an agent that sees the state.

    Attributes:
        values: Optimal expected sum of discounted rewards from each state, ``(S,)``.
        action_values: Optimal expected sum of discounted rewards from each state after each action, ``(S, A)``.
        policy: Optimal action in each state, ``(S,)``; the first of equally good ones.
        start_value: The optimal value at the start of an episode.
    """

    values: Floats
    action_values: Floats
    policy: Ints
    start_value: float

    def controller(self) -> Controller:
        """The policy as an agent, for the task as :func:`~dpsearch.pomdp.solvers.agents.fully_observed` makes it."""
        return Controller.memoryless(np.eye(self.action_values.shape[1])[self.policy])


def value_iteration(
    pomdp: TabularPOMDP, discount: float | None = None, *, steps: int | None = None, tolerance: float = 1e-11
) -> Solution:
    """The optimum of a task whose state is seen.

    Args:
        pomdp: The task.
        discount: Discount factor instead of the task's own. It may be 1 if returns are bounded; without a price of
            time, however, the policy found may then be one that never gets to its reward.
        steps: Number of steps left, for backward induction; the policy is that of the first of them. None
            iterates until the values settle.
        tolerance: Largest change of a value in the last sweep, if ``steps`` is None.

    Raises:
        ArithmeticError: If the values do not settle.
    """
    gamma = pomdp.discount if discount is None else discount
    moves, rewards = pomdp.transitions, pomdp.expected_rewards()
    shape = moves.n_rows, moves.n_columns
    following = csr_array((moves.probabilities, moves.columns, moves.starts), shape)  # row = state * A + action
    action_values = np.zeros_like(rewards)
    for _ in range(_MOST_SWEEPS if steps is None else steps):
        before = action_values
        action_values = rewards + gamma * (following @ before.max(axis=1)).reshape(rewards.shape)
        if steps is None and np.abs(action_values - before).max() < tolerance:
            break
    else:
        if steps is None:
            raise ArithmeticError(f"the values have not settled after {_MOST_SWEEPS} sweeps with discount {gamma}")
    values = action_values.max(axis=1)
    return Solution(
        values=values,
        action_values=action_values,
        policy=(action_values >= values[:, None] - _EQUAL).argmax(axis=1),
        start_value=float(pomdp.start_distribution() @ values),
    )
