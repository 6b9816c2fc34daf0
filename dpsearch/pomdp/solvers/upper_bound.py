"""An upper bound on the optimum of a small finite POMDP; with the lower bound it encloses the optimum.

The optimal value is a convex function of the belief. So it lies below the straight lines between its values at the
corners, where the state is certain, and below those that lead from there to its value at any other belief: a sawtooth.
Backups lower the values at the corners and at some beliefs between; they start at the values of seen states.

Source: M. Hauskrecht, "Value-function approximations for partially observable Markov decision processes", JAIR 13,
2000, section 4.6.
"""

from __future__ import annotations

import numpy as np

from dpsearch.pomdp.solvers.agents import Floats
from dpsearch.pomdp.solvers.point_based import Model, ValueVectors, first_joint
from dpsearch.pomdp.solvers.value_iteration import value_iteration


def upper_bound(lower: ValueVectors, *, sweeps: int = 1_000, tolerance: float = 1e-8) -> float:
    """An upper bound on the return from the start of an episode, without a step limit.

    The more beliefs, the tighter; time and memory grow with the square of their number. For small tasks.

    Args:
        lower: A lower bound. Values are backed up at its beliefs.
        sweeps: Most sweeps of backups.
        tolerance: Largest fall of a value in a sweep at which the search is over.
    """
    model = Model(lower.pomdp, lower.discount)
    states, points = lower.pomdp.n_states, lower.points
    corners = value_iteration(lower.pomdp, lower.discount).values  # (S,)
    values = points @ corners  # (N,)
    origins = np.concatenate([np.eye(states), points])
    rewards = origins @ model.rewards  # (S + N, A)
    arrivals = [[origins @ step for step in by_symbol] for by_symbol in model.steps]  # [action][symbol] (S + N, S)
    shares = [[_shares(arrival, points) for arrival in by_symbol] for by_symbol in arrivals]
    for _ in range(sweeps):
        teeth = values - points @ corners
        ahead = [
            sum(_sawtooth(arrival, share, corners, teeth) for arrival, share in zip(*of_action, strict=True))
            for of_action in zip(arrivals, shares, strict=True)
        ]
        backed_up = (rewards + lower.discount * np.stack(ahead, axis=1)).max(axis=1)
        fallen = np.concatenate([corners, values]) - backed_up
        corners, values = np.minimum(corners, backed_up[:states]), np.minimum(values, backed_up[states:])
        if fallen.max() < tolerance:
            break
    first = first_joint(lower.pomdp)
    return float(_sawtooth(first, _shares(first, points), corners, values - points @ corners).sum())


def _shares(joint: Floats, points: Floats) -> Floats:
    """Largest share of each belief ``(N, S)`` that fits into each unnormalised belief ``(n, S)``: ``(n, N)``."""
    shares = np.full((len(joint), len(points)), np.inf)
    for own, point in zip(joint.T, points.T, strict=True):
        possible = point > 0
        shares[:, possible] = np.minimum(shares[:, possible], own[:, None] / point[possible])
    return shares


def _sawtooth(joint: Floats, shares: Floats, corners: Floats, teeth: Floats) -> Floats:
    """The bound at unnormalised beliefs ``(n, S)``: ``(n,)``; teeth ``(N,)`` that point upwards do not count."""
    bound: Floats = joint @ corners + (shares * teeth).min(axis=1, initial=0.0)
    return bound
