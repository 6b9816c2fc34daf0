"""The lane engine: rollouts for environments that give a kernel, millions of steps a second on one core."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import KW_ONLY, dataclass, field
from functools import cache, cached_property
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from dpsearch.kernels.lanes import (
    FORWARD_LANES,
    FORWARD_SHARED,
    FORWARD_SINGLE,
    LANES,
    OBSERVE,
    RESET,
    SAMPLE,
    STEP,
    EnvKernel,
    address_of,
    noise_rows,
)
from dpsearch.policies.compiled import CompiledPolicy
from dpsearch.policies.policy import RecurrentPolicy
from dpsearch.rollout import lane_loop
from dpsearch.rollout.base import Rollouts, check_fit
from dpsearch.rollout.episodes import Episodes, clear_padding

# By dimensions and precision of the weights: ``play`` calls what is at an address as its weights say.
_FORWARD = {
    (1, np.dtype(np.float32)): FORWARD_SINGLE,
    (1, np.dtype(np.float64)): FORWARD_SHARED,
    (2, np.dtype(np.float64)): FORWARD_LANES,
}


@dataclass
class LaneEngine(Rollouts):
    """Plays episodes of one environment in lanes.

    Args:
        kernel: The environment's compiled dynamics.
        max_steps: Step cap of an episode.
        threads: Blocks of lanes that run side by side. Results do not depend on it.
        observation_space: The environment's own, of a single environment.
        action_space: The environment's own, of a single environment.
        reward_threshold: Mean return that counts as solved, or None if the environment names none.
        make_env: Makes one more environment of the kind; None if what there is came ready.
        mirror_signs: See ``Rollouts``.
    """

    kernel: EnvKernel
    max_steps: int
    threads: int = 1
    _: KW_ONLY
    observation_space: gym.Space[Any]
    action_space: gym.Space[Any]
    reward_threshold: float | None = None
    make_env: Callable[[], gym.Env[Any, Any]] | None = None
    mirror_signs: Sequence[float] | None = None
    _pool: ThreadPoolExecutor | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        if self.max_steps < 1 or self.threads < 1:
            raise ValueError(f"max_steps and threads must be positive, got {self.max_steps} and {self.threads}")
        self.observation_size = self.kernel.observation_size

    @cached_property
    def _environment(self) -> tuple[Any, Any, Any, Any]:
        """The environment's part of what the compiled engine is called with, gathered once."""
        kernel = self.kernel
        rows = [kernel.state_size, kernel.observation_size, kernel.action_size, noise_rows(kernel.draws)]
        return (
            np.array(
                [address_of(kernel.reset, RESET), address_of(kernel.observe, OBSERVE), address_of(kernel.step, STEP)]
            ),
            kernel.floats,
            kernel.ints,
            np.array(rows),
        )

    def __getstate__(self) -> dict[str, Any]:
        """Without what cannot be pickled, and is made again when it is needed."""
        return {name: value for name, value in vars(self).items() if name not in ("_environment", "_pool")}

    @override
    def close(self) -> None:
        """Let go of the threads; they come back when they are needed."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    @override
    def play(
        self,
        policy: RecurrentPolicy,
        weights: NDArray[np.float64],
        key: int,
        numbers: NDArray[np.uint64],
        candidates: NDArray[np.int64],
        greedy: bool,
        *,
        record: bool,
    ) -> Episodes:
        """Play the queued episodes; see ``Rollouts.play``."""
        kernel, compiled = self.kernel, policy.compiled()
        check_fit(policy, kernel.observation_size, kernel.action_size)
        weights = compiled.pack(weights, greedy)
        agent = _agent(compiled, greedy, weights.ndim, weights.dtype)
        queue = np.zeros(1, np.int64)
        jobs = (np.uint64(key), numbers, candidates, self.max_steps, queue)
        n, steps = len(numbers), self.max_steps if record else 0  # memory costs nothing until it is written
        observations = np.empty((steps, n, kernel.observation_size), np.float32)
        actions = np.empty((steps, n, kernel.action_size), np.float32)
        rewards = np.empty((steps, n), np.float32)
        returns, lengths, terminated = np.zeros(n), np.zeros(n, np.int64), np.zeros(n, np.bool_)

        def block(_: int) -> None:
            lanes = (weights, weights[None]) if weights.ndim == 1 else (np.zeros((weights.shape[1], LANES)), weights)
            outcome = (observations, actions, rewards, returns, lengths, terminated)
            lane_loop.play(*self._environment, *agent, *lanes, *jobs, *outcome)

        if self.threads == 1 or n <= 1:
            block(0)
        else:
            if self._pool is None:
                self._pool = ThreadPoolExecutor(self.threads)
            list(self._pool.map(block, range(self.threads)))
        longest = clear_padding(observations, actions, rewards, lengths) if record else 0
        return Episodes(observations[:longest], actions[:longest], rewards[:longest], lengths, terminated, returns)


@cache
def _agent(compiled: CompiledPolicy, greedy: bool, ndim: int, precision: np.dtype[Any]) -> tuple[Any, Any, Any, Any]:
    """A policy's arguments of ``play``; remembered, as gathering them takes longer than a short episode."""
    rows = [
        compiled.hidden_rows,
        compiled.scratch_rows,
        compiled.n_outputs,
        0 if greedy else noise_rows(compiled.draws),
    ]
    choose = compiled.mode if greedy else compiled.sample
    return (
        np.array([address_of(compiled.forward, _FORWARD[ndim, precision]), address_of(choose, SAMPLE)]),
        compiled.sizes,
        compiled.head_sizes,
        np.array(rows),
    )
