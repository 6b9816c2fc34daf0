"""Beliefs in a finite POMDP: the exact probability of each hidden state after all that was seen and done (Bayes)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpsearch.pomdp.model import TabularPOMDP


class BeliefFilter:
    """Follows the probability of each hidden state in N episodes side by side, for models of some thousand states.

    Args:
        pomdp: The model.
    """

    def __init__(self, pomdp: TabularPOMDP) -> None:
        self._moves = np.stack([pomdp.transition_matrix(action) for action in range(pomdp.n_actions)])  # (A, S, S)
        self._seen = np.stack([pomdp.observation_matrix(action) for action in range(pomdp.n_actions)])  # (A, S, Z)
        self._start = pomdp.start_distribution()
        self._terminal = pomdp.terminal
        self._seen_first = pomdp.first_observation_matrix()

    def start(self, symbols: ArrayLike) -> NDArray[np.float64]:
        """The beliefs ``(N, S)`` of episodes that begin with these symbols ``(N,)``.

        Raises:
            ValueError: If a symbol cannot be seen at the start.
        """
        return _normalised(self._start * self._seen_first.T[np.asarray(symbols)])

    def update(
        self, beliefs: NDArray[np.float64], actions: ArrayLike, symbols: ArrayLike, ended: ArrayLike | None = None
    ) -> NDArray[np.float64]:
        """The beliefs after one more action and the symbol that followed.

        Args:
            beliefs: Beliefs before the action, ``(N, S)``.
            actions: Actions taken, ``(N,)``.
            symbols: Symbols seen on arrival, ``(N,)``.
            ended: Whether each episode ended there, ``(N,)`` bool, which is evidence too; None if it is not known.

        Returns:
            Beliefs after the action, ``(N, S)``.

        Raises:
            ValueError: If a symbol is impossible after its action, or the episode cannot have ended or gone on.
        """
        chosen, seen = np.asarray(actions), np.asarray(symbols)
        arriving = np.empty_like(beliefs)
        for action in np.unique(chosen):  # one product for all episodes with the same action
            rows = chosen == action
            arriving[rows] = beliefs[rows] @ self._moves[action]
        joint = arriving * self._seen[chosen, :, seen]
        if ended is not None:
            joint *= self._terminal == np.asarray(ended)[:, None]
        return _normalised(joint)


def _normalised(joint: NDArray[np.float64]) -> NDArray[np.float64]:
    total = joint.sum(axis=1, keepdims=True)
    if not (total > 0.0).all():
        raise ValueError(f"what was seen in episode {total.argmin()} is impossible by the model")
    beliefs: NDArray[np.float64] = joint / total
    return beliefs
