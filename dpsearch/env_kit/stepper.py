"""Plays a kernel for the Gymnasium classes, in as many lanes as they have environments.

The scalar and the vector class both step through here, so they cannot differ. Each environment has its own
key and counts its own episodes and steps; its random numbers depend on these three alone.

The loop over blocks is Python's: to hand one of the kernel's functions to a compiled loop takes 25
microseconds a call, as long as 40 blocks played from here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dpsearch.kernels.lanes import LANES, EnvKernel, lanes_in_use, noise_rows
from dpsearch.kernels.on_demand import on_demand
from dpsearch.kernels.philox import ENVIRONMENT, draw, stream_key


@on_demand()
def _draw(keys, episodes, steps, chosen, noise):
    """Fills the noise (blocks, rows, LANES) of the chosen environments, each of which has a key of its own."""
    drawn = np.empty((noise.shape[1], 1))
    for i in range(len(keys)):
        if chosen[i]:
            draw(keys[i], episodes[i : i + 1], steps[i : i + 1], ENVIRONMENT, drawn, 1)
            noise[i // LANES, :, i % LANES] = drawn[:, 0]


class LaneStepper:
    """The states of n environments, which a kernel resets, steps and observes.

    Attributes:
        steps: Steps so far in the episode of each environment, ``(n,)``.
    """

    def __init__(self, kernel: EnvKernel, n: int) -> None:
        self.steps = np.zeros(n, np.int64)
        self._everyone = np.ones(n, np.bool_)
        self._keys = np.zeros(n, np.uint64)
        self._episodes = np.zeros(n, np.uint64)
        self._kernel = kernel
        blocks = -(-n // LANES)
        self._used = [lanes_in_use(n - LANES * block) for block in range(blocks)]
        self._state = np.zeros((blocks, kernel.state_size, LANES))
        self._action = np.zeros((blocks, kernel.action_size, LANES))
        self._padded = np.zeros((blocks * LANES, kernel.action_size))
        self._observation = np.zeros((blocks, kernel.observation_size, LANES))
        self._noise = np.full((blocks, noise_rows(kernel.draws), LANES), 0.5)
        self._reward = np.zeros((blocks, LANES))
        self._terminated = np.zeros((blocks, LANES), np.bool_)
        # The last block may have lanes left over. They are played along, unseen, from some start state.
        for lane in range(LANES):
            kernel.reset(kernel.floats, kernel.ints, self._noise[0], lane, self._state[0])
        self._state[1:] = self._state[0]

    def seed(self, i: int, seed: int) -> None:
        """Gives environment ``i`` the numbers of a seed; its next reset starts their first episode.

        Raises:
            ValueError: If the seed is not in [0, 2**64).
        """
        self.set_key(i, stream_key(seed))

    def set_key(self, i: int, key: int) -> None:
        """Gives environment ``i`` the numbers of a 64-bit key; its next reset starts their first episode."""
        self._keys[i] = key
        self._episodes[i] = 2**64 - 1  # the reset makes it 0

    def reset(self, chosen: NDArray[np.bool_]) -> None:
        """Puts the chosen environments, a mask ``(n,)``, at the start of their next episode."""
        kernel = self._kernel
        self._episodes += chosen
        self.steps[chosen] = 0
        _draw(self._keys, self._episodes, self.steps, chosen, self._noise)
        for i in np.flatnonzero(chosen):
            block, lane = divmod(i, LANES)
            kernel.reset(kernel.floats, kernel.ints, self._noise[block], lane, self._state[block])

    def put(self, i: int, state: NDArray[np.float64]) -> None:
        """Puts environment ``i`` into a state of the kernel, ``(state size,)``."""
        block, lane = divmod(i, LANES)
        self._state[block, :, lane] = state

    def step(self, actions: NDArray[np.generic]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Moves every environment one step on; where the episode is over, the result means nothing.

        Args:
            actions: The action of each environment, ``(n,)`` or ``(n, action size)``.

        Returns:
            Rewards ``(n,)``, and whether each episode has terminated ``(n,)``.
        """
        kernel = self._kernel
        n = len(self.steps)
        self.steps += 1
        _draw(self._keys, self._episodes, self.steps, self._everyone, self._noise)
        self._padded[:n] = actions.reshape(n, -1)
        self._action[:] = self._padded.reshape(len(self._action), LANES, -1).transpose(0, 2, 1)
        blocks = zip(self._noise, self._action, self._state, self._reward, self._terminated, self._used, strict=True)
        for noise, action, state, reward, terminated, lanes in blocks:
            kernel.step(kernel.floats, kernel.ints, noise, action, state, reward, terminated, lanes)
        return self._reward.ravel()[:n].copy(), self._terminated.ravel()[:n].copy()

    def observe(self) -> NDArray[np.float32]:
        """The present observation of each environment, ``(n, observation size)``."""
        kernel = self._kernel
        for state, observation, lanes in zip(self._state, self._observation, self._used, strict=True):
            kernel.observe(kernel.floats, kernel.ints, state, observation, lanes)
        return self._environments_first(self._observation).astype(np.float32)

    def state(self) -> NDArray[np.float64]:
        """The kernel's state of each environment, ``(n, state size)``."""
        return self._environments_first(self._state)

    def _environments_first(self, blocks: NDArray[np.float64]) -> NDArray[np.float64]:
        """From (blocks, rows, LANES) to a new array (n, rows)."""
        return blocks.transpose(0, 2, 1).copy().reshape(-1, blocks.shape[1])[: len(self.steps)]
