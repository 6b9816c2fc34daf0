"""Exact metrics of a finite-state controller in a finite POMDP, without sampling.

The task and the controller together are a Markov chain over pairs (state, node). Two vectors are moved along it:

    mass_t(x)   = P(L >= t, x_t = x)                   probability of still going on, in x
    earned_t(x) = E[R_t; L >= t, x_t = x]              return of these episodes so far

Episodes that end with step t leave both vectors. Their share of ``earned`` divided by t, summed over all t, is
E[R / L], the thesis's metric.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from dpsearch.pomdp.distributions import Distributions, expanded
from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.solvers.agents import BeliefAgent, Controller, Floats, Ints
from dpsearch.pomdp.solvers.returns import Estimate, Metrics
from dpsearch.pomdp.task import TabularTask

_IMPOSSIBLE = 1e-12  # a probability this small is rounding


def exact_metrics(task: TabularTask, controller: Controller) -> Metrics:
    """The metrics of a controller, step cap and discount being the task's. Their standard errors are 0.

    Raises:
        ValueError: If the controller is for other numbers of actions or symbols.
    """
    pomdp, nodes = task.pomdp, controller.n_nodes
    if controller.following.shape[1:] != (pomdp.n_actions, pomdp.n_symbols):
        raise ValueError(
            f"the controller has {controller.following.shape[1]} actions and {controller.following.shape[2]} symbols, "
            f"the task {pomdp.n_actions} and {pomdp.n_symbols}"
        )
    chain = _Chain.of(pomdp, controller)
    ends = np.repeat(pomdp.terminal, nodes)
    mass, earned = chain.start, np.zeros_like(chain.start)
    total = discounted = per_step = steps = 0.0
    factor = 1.0
    for t in range(1, task.max_episode_steps + 1):
        steps += float(mass.sum())
        paid = float(mass @ chain.rewards)
        total += paid
        discounted += factor * paid
        factor *= pomdp.discount
        earned = chain.moves @ earned + chain.rewarded_moves @ mass
        mass = chain.moves @ mass
        over = ends if t < task.max_episode_steps else np.ones_like(ends)
        per_step += float(earned[over].sum()) / t
        mass[over] = earned[over] = 0.0
        if not mass.any():
            break
    values = (total, total / steps, per_step, discounted, steps)
    return Metrics(*(Estimate(value) for value in values))


@dataclass(frozen=True)
class _Chain:
    """Task and controller as one Markov chain over X = S K pairs, ``state * K + node``.

    Attributes:
        start: Probability of each pair at the start, ``(X,)``.
        moves: Probability of each pair, given the pair before, ``(X, X)`` as ``[after, before]``.
        rewarded_moves: ``moves`` times the mean reward of each step, ``(X, X)``.
        rewards: Mean reward of the step that follows a pair, ``(X,)``.
    """

    start: Floats
    moves: csr_array
    rewarded_moves: csr_array
    rewards: Floats

    @classmethod
    def of(cls, pomdp: TabularPOMDP, controller: Controller) -> _Chain:
        nodes = controller.n_nodes
        pairs = pomdp.n_states * nodes
        drawn, symbol, seen = _expand(pomdp.observations, pomdp.first_observation_row[pomdp.start.columns])
        first = pomdp.start.columns[drawn] * nodes + controller.first[symbol]
        start = np.zeros(pairs)
        np.add.at(start, first, pomdp.start.probabilities[drawn] * seen)

        moves, rewarded = csr_array((pairs, pairs)), csr_array((pairs, pairs))
        state, action = np.divmod(pomdp.transitions.row_of_entry(), pomdp.n_actions)
        for a in range(pomdp.n_actions):
            entries = np.flatnonzero((action == a) & ~pomdp.terminal[state])
            taken, symbol, seen = _expand(
                pomdp.observations, pomdp.observation_row[pomdp.transitions.columns[entries], a]
            )
            entry = entries[taken][:, None]  # one line for each transition and symbol, one column for each node
            node = np.flatnonzero(controller.actions[:, a])
            before = state[entry] * nodes + node
            after = pomdp.transitions.columns[entry] * nodes + controller.following[node, a, symbol[:, None]]
            probability = pomdp.transitions.probabilities[entry] * seen[:, None] * controller.actions[node, a]
            where = after.ravel(), before.ravel()
            moves += csr_array((probability.ravel(), where), (pairs, pairs))
            rewarded += csr_array(((probability * pomdp.rewards[entry]).ravel(), where), (pairs, pairs))
        return cls(start, moves, rewarded, rewarded.sum(axis=0))


def _expand(distributions: Distributions, rows: Ints) -> tuple[Ints, Ints, Floats]:
    """All outcomes that may be drawn from some rows ``(n,)``.

    Returns:
        For each possible outcome, the index of its row (below n), the outcome, and its probability.
    """
    lengths = np.diff(distributions.starts)[rows]
    entry, drawn = expanded(distributions.starts[rows], lengths)
    return drawn, distributions.columns[entry], distributions.probabilities[entry]


def controller_of(agent: BeliefAgent, most: int = 10_000, digits: int = 10) -> Controller:
    """The finite-state controller that acts as an agent on beliefs, if it can reach only a few beliefs.

    Args:
        agent: The agent.
        most: Largest number of nodes.
        digits: Decimals in which the beliefs of one node agree.

    Raises:
        ValueError: If the controller would need more nodes.
    """
    pomdp = agent.pomdp
    moves = [pomdp.transition_matrix(action) for action in range(pomdp.n_actions)]
    seen = [pomdp.observation_matrix(action) * ~pomdp.terminal[:, None] for action in range(pomdp.n_actions)]
    nodes = _Nodes(most, digits)
    first = np.zeros(pomdp.n_symbols, np.int64)
    possible = np.flatnonzero(pomdp.start_distribution() @ pomdp.first_observation_matrix() > _IMPOSSIBLE)
    first[possible] = nodes.number(agent.start(possible))
    actions: list[int] = []
    following: list[Ints] = []
    while len(actions) < len(nodes.beliefs):
        belief = nodes.beliefs[len(actions)][None]
        action = int(agent.decide(belief)[0])
        possible = np.flatnonzero(belief[0] @ moves[action] @ seen[action] > _IMPOSSIBLE)
        after = np.zeros(pomdp.n_symbols, np.int64)
        if len(possible):
            same = [0] * len(possible)
            after[possible] = nodes.number(agent.update(belief[same], np.full(len(possible), action), possible))
        actions.append(action)
        following.append(after)
    return Controller.deterministic(actions, first, np.stack(following), pomdp.n_actions)


class _Nodes:
    """Numbers for beliefs; beliefs that agree share one."""

    def __init__(self, most: int, digits: int) -> None:
        self.beliefs: list[Floats] = []
        self._numbers: dict[bytes, int] = {}
        self._most, self._digits = most, digits

    def number(self, beliefs: Floats) -> Ints:
        """The numbers ``(n,)`` of beliefs ``(n, S)``."""
        numbers = np.empty(len(beliefs), np.int64)
        for i, belief in enumerate(beliefs):
            key = (np.round(belief, self._digits) + 0.0).tobytes()  # -0.0 becomes 0.0
            numbers[i] = self._numbers.setdefault(key, len(self.beliefs))
            if numbers[i] == len(self.beliefs):
                self.beliefs.append(belief)
        if len(self.beliefs) > self._most:
            raise ValueError(f"the agent may have more than {self._most} different beliefs")
        return numbers
