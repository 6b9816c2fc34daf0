"""The generality of a pole balancer: the number of 625 starts from which it keeps the poles up.

The test of F. Gruau, D. Whitley and L. Pyeatt, "A comparison between cellular encoding and direct encoding for genetic
neural networks", GP 1996, which the literature on two poles has used ever since. A balancer counts as general if it
copes with 200 of them.

The lane engine plays all starts in one call. An episode's start is a function of its number: so the test looks up, for
every start, the number of an episode that begins there, and has exactly these episodes played.
"""

from __future__ import annotations

from contextlib import closing
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpsearch.kernels.lanes import LANES, EnvKernel, noise_rows
from dpsearch.kernels.philox import ENVIRONMENT, draw, stream_key
from dpsearch.policies.policy import RecurrentPolicy
from dpsearch.rollout.gym_envs import EnvSource
from dpsearch.rollout.lane_engine import LaneEngine
from dpsearch.rollout.make import make_rollouts

TWO_POLES = "dpsearch.envs:dpsearch/DoublePoleHidden-v0"


def generalisation_test(
    policy: RecurrentPolicy,
    env: EnvSource = TWO_POLES,
    *,
    steps: int = 1000,
    greedy: bool = True,
    threads: int = 1,
    **env_kwargs: Any,
) -> int:
    """The number of the 625 starts from which a policy keeps the poles up; see ``balanced_starts``."""
    return int(balanced_starts(policy, env, steps=steps, greedy=greedy, threads=threads, **env_kwargs).sum())


def balanced_starts(
    policy: RecurrentPolicy,
    env: EnvSource = TWO_POLES,
    *,
    steps: int = 1000,
    greedy: bool = True,
    threads: int = 1,
    **env_kwargs: Any,
) -> NDArray[np.bool_]:
    """The starts from which a policy keeps the poles up.

    Args:
        policy: The balancer.
        env: Id or class of a task of balancing poles.
        steps: Number of steps for which the poles must stay up, at most 100,000.
        greedy: Take the most probable action instead of a random one.
        threads: Number of threads; results do not depend on it.
        **env_kwargs: Arguments of the environment, apart from ``reward``, ``start_state`` and ``max_episode_steps``.

    Returns:
        ``(625,)``, in the order of ``dpsearch.envs.poles.env.generalisation_starts``.

    Raises:
        ValueError: If the task is not pole balancing, an argument is out of range, or the policy does not fit.
        TypeError: If the environment does not know an argument.
    """
    from dpsearch.envs.poles.env import GENERALISATION, generalisation_starts

    refused = {"reward", "start_state"} & env_kwargs.keys()
    if refused or steps < 1:
        wrong = f"{sorted(refused)[0]}, which the test sets itself" if refused else f"steps={steps}: at least 1"
        raise ValueError(f"the generalisation test does not take {wrong}")
    arguments = {**env_kwargs, "reward": "steps", "start_state": GENERALISATION}
    key = stream_key(0)
    with closing(make_rollouts(env, threads=threads, env_kwargs=arguments, max_episode_steps=steps)) as rollouts:
        if not isinstance(rollouts, LaneEngine):
            raise ValueError("the test needs a task of balancing poles, without wrappers")
        if steps > rollouts.max_steps:
            raise ValueError(f"steps must be at most {rollouts.max_steps}, got {steps}")
        starts = generalisation_starts(rollouts.kernel.state_size // 2 - 1)
        episodes = _episode_of_each_start(rollouts.kernel, starts, key)
        returns, _ = rollouts.evaluate(policy, policy.vector()[None], key=key, episodes=episodes[None], greedy=greedy)
    balanced: NDArray[np.bool_] = returns[0] >= steps
    return balanced


def _episode_of_each_start(kernel: EnvKernel, starts: NDArray[np.float64], key: int) -> NDArray[np.uint64]:
    """The number of an episode that begins at each of the starts ``(625, S)``, ``(625,)``."""
    state, noise = np.zeros((kernel.state_size, LANES)), np.zeros((noise_rows(kernel.draws), LANES))
    episodes, beginning = np.arange(LANES, dtype=np.uint64), np.zeros(LANES, np.int64)
    found: dict[bytes, np.uint64] = {}
    while len(found) < len(starts):  # seven times as many episodes as starts, as a rule
        draw(np.uint64(key), episodes, beginning, ENVIRONMENT, noise, LANES)
        for lane in range(LANES):
            kernel.reset(kernel.floats, kernel.ints, noise, lane, state)
        for start, episode in zip(state.T, episodes, strict=True):
            found.setdefault(start.tobytes(), episode)
        episodes += np.uint64(LANES)
    return np.array([found[start.tobytes()] for start in starts])
