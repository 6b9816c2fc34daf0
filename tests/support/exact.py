"""What policies with a finite memory achieve in small finite POMDPs, by propagating probabilities; and the optimum for
those who see the state. Dense and slow, and independent of everything but the tables' dense views."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from dpsearch.pomdp import TabularPOMDP

Floats = NDArray[np.float64]
Memory = TypeVar("Memory", bound=Hashable)


@dataclass(frozen=True)
class Values:
    """In the order of the columns of the reference tables."""

    mean_return: float
    reward_per_step: float  # ratio of sums
    mean_of_ratios: float
    discounted: float
    steps: float

    def require(self, printed: str) -> None:
        """Agrees with numbers as they are printed: "106.102 1.06102 1.06102 1.93344 100"; ``*`` for any."""
        found = (self.mean_return, self.reward_per_step, self.mean_of_ratios, self.discounted, self.steps)
        for value, text in zip(found, printed.split(), strict=True):
            if text != "*":
                digits = len(text.partition(".")[2])
                assert value == pytest.approx(float(text), abs=0.5 * 10**-digits + 1e-9), printed


@dataclass(frozen=True)
class Machine:
    """A policy with K nodes of memory.

    Attributes:
        actions: Probability of each action in each node, ``(K, A)``.
        first: Node after each first symbol, ``(Z,)``.
        following: Node after each node and symbol, ``(K, Z)``.
    """

    actions: Floats
    first: Sequence[int]
    following: ArrayLike


def memoryless(actions: ArrayLike) -> Machine:
    """Probabilities of actions for each symbol, ``(Z, A)``."""
    probabilities = np.asarray(actions, np.float64)
    symbols = range(len(probabilities))
    return Machine(probabilities, symbols, [symbols] * len(symbols))


def at_random(pomdp: TabularPOMDP) -> Machine:
    actions, symbols = pomdp.n_actions, pomdp.n_symbols
    return Machine(np.full((1, actions), 1 / actions), [0] * symbols, [[0] * symbols])


def machine(
    pomdp: TabularPOMDP,
    first: Callable[[int], Memory],
    act: Callable[[Memory], int],
    following: Callable[[Memory, int], Memory],
) -> Machine:
    """A deterministic policy: what it keeps in mind after the first symbol, what it then does, and what it keeps next.

    Its nodes are all that it may ever keep in mind.
    """
    symbols = range(pomdp.n_symbols)
    nodes = list(dict.fromkeys(first(symbol) for symbol in symbols))
    for node in nodes:  # grows on the way
        nodes += dict.fromkeys(after for symbol in symbols if (after := following(node, symbol)) not in nodes)
    return Machine(
        np.eye(pomdp.n_actions)[[act(node) for node in nodes]],
        [nodes.index(first(symbol)) for symbol in symbols],
        [[nodes.index(following(node, symbol)) for symbol in symbols] for node in nodes],
    )


def reward_table(pomdp: TabularPOMDP) -> Floats:
    """Probability times reward, ``(A, S, S)`` as ``[action, state, next state]``."""
    table = np.zeros((pomdp.n_actions, pomdp.n_states, pomdp.n_states))
    state, action = np.divmod(pomdp.transitions.row_of_entry(), pomdp.n_actions)
    np.add.at(table, (action, state, pomdp.transitions.columns), pomdp.transitions.probabilities * pomdp.rewards)
    return table


def play(pomdp: TabularPOMDP, policy: Machine, limit: int) -> Values:
    """What a policy achieves in episodes of at most so many steps."""
    moves = np.stack([pomdp.transition_matrix(a) for a in range(pomdp.n_actions)])
    seen = np.stack([pomdp.observation_matrix(a) for a in range(pomdp.n_actions)])
    nodes = len(policy.actions)
    enters, goes_to = np.eye(nodes)[list(policy.first)], np.eye(nodes)[np.asarray(policy.following)]
    pairs = pomdp.n_states * nodes  # of a state and a node
    chain, paying = (
        np.einsum("ka,ast,atz,kzj->sktj", policy.actions, table, seen, goes_to, optimize=True).reshape(pairs, pairs)
        for table in (moves, reward_table(pomdp))
    )
    over = np.repeat(pomdp.terminal, nodes)
    mass = (pomdp.start_distribution()[:, None] * (pomdp.first_observation_matrix() @ enters)).ravel()
    earned = np.zeros(pairs)  # mass times what these episodes have earned
    total = discounted = ratios = steps = 0.0
    for t in range(limit):
        steps += mass.sum()
        reward = (mass @ paying).sum()
        total += reward
        discounted += pomdp.discount**t * reward
        mass, earned = mass @ chain, earned @ chain + mass @ paying
        ending = over if t + 1 < limit else np.ones_like(over)
        ratios += earned[ending].sum() / (t + 1)
        mass[ending] = earned[ending] = 0.0
    return Values(total, total / steps, ratios, discounted, steps)


def solve(pomdp: TabularPOMDP, discount: float) -> tuple[Floats, NDArray[np.int64]]:
    """Value and best action of each state ``(S,)``, for those who see it."""
    moves = np.stack([pomdp.transition_matrix(a) for a in range(pomdp.n_actions)])
    rewards, values = pomdp.expected_rewards(), np.zeros(pomdp.n_states)
    while True:
        worth = rewards + discount * (moves @ values).T  # (S, A)
        change = np.abs(worth.max(axis=1) - values).max()
        values = worth.max(axis=1)
        if change < 1e-12:
            return values, worth.argmax(axis=1)


def chain_of(pomdp: TabularPOMDP, policy: NDArray[np.int64]) -> TabularPOMDP:
    """What is left of a model when its only action is what a policy does in each state ``(S,)``."""
    states = np.arange(pomdp.n_states)
    moves = np.stack([pomdp.transition_matrix(a) for a in range(pomdp.n_actions)])[policy, states]
    paid = reward_table(pomdp)[policy, states]
    rewards = np.divide(paid, moves, out=np.zeros_like(paid), where=moves > 0)
    return TabularPOMDP.from_dense(
        moves[None],
        np.ones((1, pomdp.n_states, 1)),
        rewards[None],
        pomdp.start_distribution(),
        first_observation=[1.0],
        terminal=np.flatnonzero(pomdp.terminal),
        discount=pomdp.discount,
    )
