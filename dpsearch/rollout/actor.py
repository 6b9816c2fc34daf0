"""A policy at work in many lanes at once, with the compiled functions and the keyed noise of the lane engine.

So both engines take the same actions for the same observations, bit for bit, and what happens in one lane
does not depend on the others.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpsearch.kernels.lanes import LANES, lanes_in_use, noise_rows
from dpsearch.kernels.philox import ACTION, draw
from dpsearch.policies.compiled import remember_action
from dpsearch.policies.policy import RecurrentPolicy


class LaneActor:
    """Chooses the actions in L lanes.

    Args:
        policy: The policy, for its architecture.
        weights: ``(P,)`` for all lanes, or ``(N, P)``, candidates of which each lane plays one.
        lanes: L.
        key: 64-bit key of the action noise.
        greedy: Take the most probable action instead of a random one.
    """

    def __init__(
        self, policy: RecurrentPolicy, weights: NDArray[np.float64], lanes: int, key: int, greedy: bool
    ) -> None:
        self._compiled = compiled = policy.compiled()
        weights = compiled.pack(weights, greedy)
        self._choose = compiled.mode if greedy else compiled.sample
        self._key = np.uint64(key)
        self._lanes = lanes
        blocks = -(-lanes // LANES)
        self._population = weights if weights.ndim == 2 else None
        self._weights = weights if self._population is None else np.zeros((blocks, weights.shape[1], LANES))
        self._padded = np.zeros((blocks * LANES, policy.observation_size))
        self._observation = np.zeros((blocks, policy.observation_size, LANES))
        self._hidden = np.zeros((blocks, compiled.hidden_rows, LANES), weights.dtype)
        self._action = np.zeros((blocks, compiled.action_size, LANES))
        self._scratch = np.zeros((compiled.scratch_rows, LANES), weights.dtype)
        self._output = np.zeros((compiled.n_outputs, LANES))
        self._noise = np.zeros((0 if greedy else noise_rows(compiled.draws), LANES))
        self._episode = np.zeros((blocks, LANES), np.uint64)
        self._time = np.zeros((blocks, LANES), np.int64)

    def begin(
        self, lanes: NDArray[np.integer[Any]], episodes: NDArray[np.uint64], candidates: NDArray[np.int64]
    ) -> None:
        """Forget everything in some lanes: an episode begins.

        Args:
            lanes: Their indices ``(n,)``.
            episodes: The numbers ``(n,)`` of the episodes, which key the noise.
            candidates: Whose weights play them, ``(n,)``.
        """
        block, lane = np.divmod(lanes, LANES)
        self._hidden[block, :, lane] = 0.0
        self._time[block, lane] = 0
        self._episode[block, lane] = episodes
        if self._population is not None:
            self._weights[block, :, lane] = self._population[candidates]

    @property
    def memory(self) -> NDArray[np.floating]:
        """The recurrent state of every lane, a copy ``(L, state_size)``."""
        memory: NDArray[np.floating] = self._hidden.swapaxes(1, 2).reshape(len(self._padded), -1)[: self._lanes].copy()
        return memory

    def resume(self, memory: NDArray[np.floating], time: int) -> None:
        """Go on in the middle of episodes.

        Args:
            memory: What ``memory`` was, ``(L, state_size)``.
            time: Steps of each episode that have been played.
        """
        block, lane = np.divmod(np.arange(self._lanes), LANES)
        self._hidden[block, :, lane] = memory
        self._time[block, lane] = time

    def act(self, observations: NDArray[np.float32]) -> NDArray[np.float64]:
        """The actions ``(L, A)`` for observations ``(L, O)``, one step on."""
        compiled, lanes = self._compiled, len(observations)
        self._padded[:lanes] = observations
        self._observation[:] = self._padded.reshape(len(self._observation), LANES, -1).swapaxes(1, 2)
        for b, observation in enumerate(self._observation):
            weights = self._weights if self._population is None else self._weights[b]
            hidden, used = self._hidden[b], lanes_in_use(lanes - b * LANES)
            compiled.forward(compiled.sizes, weights, observation, hidden, self._scratch, self._output, used)
            draw(self._key, self._episode[b], self._time[b], ACTION, self._noise, used)
            self._choose(compiled.head_sizes, self._noise, self._output, self._action[b], used)
            remember_action(compiled.sizes, compiled.head_sizes, self._output, self._action[b], hidden)
        self._time += 1
        actions: NDArray[np.float64] = self._action.swapaxes(1, 2).reshape(len(self._padded), -1)[:lanes]
        return actions
