"""Policies that are not learned, for finite POMDPs: controllers with a finite memory, and policies on beliefs.

Learned policies are measured by them. Each is a few pure functions of its memory, an array with a row for each of
N episodes that are played side by side, so whoever plays it may drop rows as episodes end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpsearch.pomdp.belief import BeliefFilter
from dpsearch.pomdp.distributions import Distributions
from dpsearch.pomdp.model import TabularPOMDP

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]


class Agent(Protocol):
    """A policy that remembers."""

    def start(self, symbols: Ints) -> NDArray[Any]:
        """The memory, ``(N, ..)``, in episodes that begin with these symbols ``(N,)``."""

    def choose(self, memory: NDArray[Any], uniforms: Floats) -> Ints:
        """The actions ``(N,)``; ``uniforms`` ``(N,)`` in [0, 1) are there to draw them with."""

    def update(self, memory: NDArray[Any], actions: Ints, symbols: Ints) -> NDArray[Any]:
        """The memory after these actions ``(N,)``, where the episode went on and showed these symbols ``(N,)``."""


@dataclass(frozen=True, eq=False)
class Controller:
    """An agent with K memory states, called nodes: a finite-state controller (Hansen, UAI 1998).

    Attributes:
        actions: Probability of each action in each node, ``(K, A)``.
        first: First node of an episode, by the first symbol, ``(Z,)``.
        following: Next node, by the node, the action taken in it and the symbol that followed, ``(K, A, Z)``.

    Raises:
        ValueError: If shapes do not fit, a node is out of range or probabilities do not sum to 1.
    """

    actions: Floats
    first: Ints
    following: Ints

    def __post_init__(self) -> None:
        if self.following.shape != (*self.actions.shape, len(self.first)):
            shapes = f"{self.actions.shape}, {self.first.shape} and {self.following.shape}"
            raise ValueError(f"shapes must be (K, A), (Z,) and (K, A, Z), got {shapes}")
        for name in ("first", "following"):
            nodes = getattr(self, name)
            if nodes.min() < 0 or nodes.max() >= self.n_nodes:
                raise ValueError(f"{name} must hold nodes from 0 to {self.n_nodes - 1}")
        if (self.actions < 0).any() or not np.allclose(self.actions.sum(axis=1), 1, rtol=0, atol=1e-9):
            raise ValueError("the actions of a node must have probabilities that sum to 1")

    @classmethod
    def deterministic(cls, actions: ArrayLike, first: ArrayLike, following: ArrayLike, n_actions: int) -> Controller:
        """A controller that does one thing in each node.

        Args:
            actions: The action of each node, ``(K,)``.
            first: First node of an episode, by the first symbol, ``(Z,)``.
            following: Next node, by the node and the symbol that followed, ``(K, Z)``.
            n_actions: A, the number of actions.

        Raises:
            ValueError: If something does not fit.
        """
        nodes = np.asarray(following, np.int64)[:, None, :]
        return cls(
            np.eye(n_actions)[np.asarray(actions)],
            np.asarray(first, np.int64),
            np.repeat(nodes, n_actions, axis=1),
        )

    @classmethod
    def memoryless(cls, actions: ArrayLike) -> Controller:
        """A memoryless controller: ``actions`` ``(Z, A)`` are the probabilities of actions for each symbol."""
        probabilities = np.asarray(actions, np.float64)
        symbols = np.arange(len(probabilities))
        return cls(probabilities, symbols, np.broadcast_to(symbols, (*probabilities.shape, len(symbols))))

    @classmethod
    def random(cls, pomdp: TabularPOMDP) -> Controller:
        """A controller that takes all actions with equal probability."""
        shape = (1, pomdp.n_actions, pomdp.n_symbols)
        return cls(np.full(shape[:2], 1 / pomdp.n_actions), np.zeros(shape[2], np.int64), np.zeros(shape, np.int64))

    @property
    def n_nodes(self) -> int:
        """K, the number of nodes."""
        return len(self.actions)

    def start(self, symbols: Ints) -> Ints:
        """The nodes ``(N,)`` in which episodes begin."""
        return self.first[symbols]

    def choose(self, memory: Ints, uniforms: Floats) -> Ints:
        """Actions drawn with the probabilities of the nodes."""
        below = np.cumsum(self.actions[memory, :-1], axis=1) <= uniforms[:, None]
        chosen: Ints = below.sum(axis=1)
        return chosen

    def update(self, memory: Ints, actions: Ints, symbols: Ints) -> Ints:
        """The next nodes ``(N,)``."""
        return self.following[memory, actions, symbols]


class BeliefAgent:
    """An agent that decides by its belief, which it updates by Bayes' rule; its memory is ``(N, S)``.

    Args:
        pomdp: The model.
        decide: Function from beliefs ``(N, S)`` to actions ``(N,)``.
    """

    def __init__(self, pomdp: TabularPOMDP, decide: Callable[[Floats], Ints]) -> None:
        self.pomdp = pomdp
        self.decide = decide
        self._filter = BeliefFilter(pomdp)

    def start(self, symbols: Ints) -> Floats:
        """The first beliefs."""
        return self._filter.start(symbols)

    def choose(self, memory: Floats, uniforms: Floats) -> Ints:
        """The actions that ``decide`` gives; nothing is drawn."""
        return self.decide(memory)

    def update(self, memory: Floats, actions: Ints, symbols: Ints) -> Floats:
        """The beliefs after a step. That the episode goes on rules out the states that would have ended it.

        Raises:
            ValueError: If a symbol is impossible after its action in an episode that goes on.
        """
        return self._filter.update(memory, actions, symbols, ended=np.zeros(len(symbols), np.bool_))


def fully_observed(pomdp: TabularPOMDP) -> TabularPOMDP:
    """The task with its hidden state in sight: S symbols, each the number of a state.

    With equal seeds and actions, the states equal those of the original task, for the same numbers draw them.
    """
    states = np.arange(pomdp.n_states)
    sight = Distributions(np.arange(pomdp.n_states + 1), states, np.ones(pomdp.n_states), pomdp.n_states)
    return replace(
        pomdp,
        observations=sight,
        observation_row=np.repeat(states[:, None], pomdp.n_actions, axis=1),
        first_observation_row=states,
        features=np.eye(pomdp.n_states),
        observation_names=pomdp.state_names,
    )
