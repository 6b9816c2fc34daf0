"""The optimum of a small finite POMDP from below, by point-based value iteration.

The optimal value is a convex function of the belief. Vectors bound it from below, one for each of some plans: the
return of the plan from each state. A belief's value is the largest of its products with the vectors. A backup at a
belief makes the vector of the best plan that takes one action there and then, depending on the symbol, goes on with a
known plan. All beliefs of a set are backed up at once, again and again; then the set is extended by beliefs that the
resulting policy meets when it acts at random now and then.

Source: J. Pineau, G. Gordon and S. Thrun, "Point-based value iteration: an anytime algorithm for POMDPs", IJCAI 2003;
M. T. J. Spaan and N. Vlassis, "Perseus: randomized point-based value iteration for POMDPs", JAIR 24, 2005.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.solvers.agents import BeliefAgent, Floats, Ints

_DIGITS = 3  # beliefs that agree in so many decimals count as one
_STEPS = 100  # steps of each episode in which beliefs are collected


@dataclass(frozen=True, eq=False)
class ValueVectors:
    """A lower bound of the optimal value, and the policy that goes with it.

    Attributes:
        pomdp: The task.
        discount: Discount factor of the values.
        vectors: Expected return of each of M plans from each state, ``(M, S)``.
        actions: First action of each plan, ``(M,)``.
        points: Beliefs at which the bound was raised, ``(N, S)``.
    """

    pomdp: TabularPOMDP
    discount: float
    vectors: Floats
    actions: Ints
    points: Floats

    def values(self, beliefs: Floats) -> Floats:
        """The bound at beliefs ``(N, S)``: ``(N,)``."""
        best: Floats = (beliefs @ self.vectors.T).max(axis=1)
        return best

    def decide(self, beliefs: Floats) -> Ints:
        """First actions ``(N,)`` of the best plans at beliefs ``(N, S)``."""
        actions: Ints = self.actions[(beliefs @ self.vectors.T).argmax(axis=1)]
        return actions

    def agent(self) -> BeliefAgent:
        """The policy that goes with the bound."""
        return BeliefAgent(self.pomdp, self.decide)

    @property
    def start_value(self) -> float:
        """The bound at the start of an episode, before the first symbol is seen."""
        return float(self.values(first_joint(self.pomdp)).sum())


def point_based(
    pomdp: TabularPOMDP,
    discount: float | None = None,
    *,
    rounds: int = 5,
    beliefs: int = 200,
    sweeps: int = 200,
    tolerance: float = 1e-8,
    seed: int = 0,
) -> ValueVectors:
    """Solves a task without a step cap.

    The defaults solve all tasks of section 6.3 and short T-mazes in a second. For the 89-state maze they would take
    many minutes; with ``rounds=3, beliefs=60, tolerance=1e-3`` it takes seconds to a policy that is nearly as good.

    Args:
        pomdp: The task.
        discount: Discount factor, below 1, instead of the task's own; 0.9999 in place of 1 changes a return of
            episodes of some ten steps in its third decimal at most.
        rounds: Number of times that the set of beliefs is extended.
        beliefs: Most beliefs that a round adds.
        sweeps: Most sweeps of backups in a round.
        tolerance: Largest rise of a value in a sweep at which a round is over.
        seed: Seed of the episodes in which beliefs are collected.

    Raises:
        ValueError: If the discount is not below 1.
    """
    gamma = pomdp.discount if discount is None else discount
    if not gamma < 1:
        raise ValueError(f"the discount must be below 1, got {gamma}")
    model = Model(pomdp, gamma)
    random = np.random.default_rng(seed)
    bound = model.blind()
    for _ in range(rounds):
        points = _extended(bound.points, model.met(bound, beliefs, random), beliefs, random)
        for _ in range(sweeps):
            before = bound.values(points)
            bound = model.swept(bound, points)
            if (bound.values(points) - before).max() < tolerance:
                break
    return bound


class Model:
    """The tables of a task in the form that backups need.

    Args:
        pomdp: The task.
        gamma: The discount factor.

    Attributes:
        rewards: Mean reward of each action in each state, ``(S, A)``.
        steps: Probability of going on to a state and seeing a symbol there, ``(A, Z, S, S)`` as
            ``[action, symbol, state, next state]``. Ended episodes are left out: nothing is earned there.
    """

    def __init__(self, pomdp: TabularPOMDP, gamma: float) -> None:
        self.pomdp, self.gamma = pomdp, gamma
        self.rewards = pomdp.expected_rewards()
        self.steps = np.stack(
            [
                pomdp.transition_matrix(a) * (pomdp.observation_matrix(a) * ~pomdp.terminal[:, None]).T[:, None, :]
                for a in range(pomdp.n_actions)
            ]
        )

    def blind(self) -> ValueVectors:
        """The plans that repeat one action for ever."""
        all_seen = self.steps.sum(axis=1)
        unit = np.eye(self.pomdp.n_states)
        vectors = [
            np.linalg.solve(unit - self.gamma * matrix, rewards)
            for matrix, rewards in zip(all_seen, self.rewards.T, strict=True)
        ]
        return ValueVectors(self.pomdp, self.gamma, np.stack(vectors), np.arange(self.pomdp.n_actions), unit[:0])

    def backed_up(self, bound: ValueVectors, points: Floats) -> tuple[Floats, Ints]:
        """The best plan at each belief ``(N, S)`` that goes on with a plan of the bound: vectors and actions."""
        vectors = np.zeros_like(points)
        actions = np.zeros(len(points), np.int64)
        best = np.full(len(points), -np.inf)
        for action, by_symbol in enumerate(self.steps):
            plan = np.tile(self.rewards[:, action], (len(points), 1))
            for step in by_symbol:
                if step.any():
                    chosen = (points @ step @ bound.vectors.T).argmax(axis=1)
                    plan += self.gamma * (bound.vectors @ step.T)[chosen]
            value = (points * plan).sum(axis=1)
            better = value > best
            vectors[better], actions[better], best[better] = plan[better], action, value[better]
        return vectors, actions

    def swept(self, bound: ValueVectors, points: Floats) -> ValueVectors:
        """The bound after a backup at every belief; only vectors that are best at some belief are kept."""
        vectors, actions = self.backed_up(bound, points)
        vectors, actions = np.concatenate([bound.vectors, vectors]), np.concatenate([bound.actions, actions])
        kept = np.unique((points @ vectors.T).argmax(axis=1))
        return ValueVectors(self.pomdp, self.gamma, vectors[kept], actions[kept], points)

    def met(self, bound: ValueVectors, episodes: int, random: np.random.Generator) -> Floats:
        """Beliefs ``(n, S)`` met in episodes that the model plays by itself.

        The first episode acts as the bound says, the last at random, and those between more and more randomly.
        """
        joint = first_joint(self.pomdp)
        weight = joint.sum(axis=1)
        possible = joint[weight > 0] / weight[weight > 0, None]
        current = possible[random.choice(len(possible), episodes, p=weight[weight > 0])]
        recklessness = np.linspace(0, 1, episodes)
        found = [possible]
        for _ in range(_STEPS):
            actions = bound.decide(current)
            at_random = random.random(len(current)) < recklessness
            actions[at_random] = random.integers(self.pomdp.n_actions, size=at_random.sum())
            joint = np.empty((len(current), *self.steps.shape[1:3]))  # (n, Z, S)
            for action in np.unique(actions):
                joint[actions == action] = (current[actions == action] @ self.steps[action]).swapaxes(0, 1)
            seen = (joint.sum(axis=2).cumsum(axis=1) <= random.random(len(current))[:, None]).sum(axis=1)
            goes_on = seen < self.pomdp.n_symbols
            if not goes_on.any():
                break
            current = joint[goes_on, seen[goes_on]]
            current /= current.sum(axis=1, keepdims=True)
            recklessness = recklessness[goes_on]
            found.append(current)
        return np.concatenate(found)


def first_joint(pomdp: TabularPOMDP) -> Floats:
    """Probability of each first symbol and start state, ``(Z, S)``."""
    joint: Floats = (pomdp.start_distribution()[:, None] * pomdp.first_observation_matrix()).T
    return joint


def _extended(points: Floats, met: Floats, most: int, random: np.random.Generator) -> Floats:
    """Beliefs ``(N, S)``, followed by at most ``most`` of those met that differ from them and from each other."""
    known = {row.tobytes() for row in points.round(_DIGITS)}
    different = np.unique(met.round(_DIGITS), axis=0, return_index=True)[1]
    new = np.array([i for i in different if met[i].round(_DIGITS).tobytes() not in known], np.int64)
    return np.concatenate([points, met[random.permutation(new)[:most]]])
