"""What is played beside an episode, and in which lane, is of no account: lanes close up as episodes end."""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from dpsearch.envs import TMaze
from dpsearch.envs.driving.rules import OBSERVATIONS
from dpsearch.envs.driving.track import Track
from dpsearch.envs.poles.env import DoublePoleHidden
from dpsearch.kernels.philox import stream_key
from dpsearch.policies import PolicyConfig, RecurrentPolicy
from dpsearch.rollout import LaneEngine

KEY = stream_key(3)
EPISODES = 37  # more than a block has lanes, of very unequal lengths
ENVS: dict[str, Callable[[], Any]] = {
    "T-maze": lambda: TMaze(4),
    "poles": DoublePoleHidden,
    "damping": lambda: DoublePoleHidden(reward="damping"),
    "track": lambda: Track(observations=tuple(OBSERVATIONS), start="random"),
}


def rollouts(env: gym.Env[Any, Any], threads: int) -> LaneEngine:
    return LaneEngine(
        env.kernel,  # type: ignore[attr-defined]
        200,
        threads,
        observation_space=env.observation_space,
        action_space=env.action_space,
    )


def policies(env: gym.Env[Any, Any], n: int, deterministic: bool, **options: Any) -> list[RecurrentPolicy]:
    config = PolicyConfig(hidden_size=3, init_range=0.7, **options)
    spaces = env.observation_space, env.action_space
    return [RecurrentPolicy.for_spaces(*spaces, config, deterministic=deterministic, seed=seed) for seed in range(n)]


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    ("env_name", "options"),
    [
        *((name, {"previous_action": True}) for name in ENVS),
        *((name, {"noise_memory": 0.5}) for name in ENVS if name != "T-maze"),  # only Gaussian noise can last
    ],
)
def test_a_recorded_episode_is_the_same_alone(env_name: str, options: dict[str, Any], threads: int) -> None:
    env = ENVS[env_name]()
    (policy,) = policies(env, 1, deterministic=False, **options)
    together, alone = rollouts(env, threads), rollouts(env, 1)
    many = together.collect(policy, EPISODES, key=KEY)
    for k in range(0, EPISODES, 4):
        one = alone.collect(policy, 1, key=KEY, first_episode=k)
        steps = one.lengths[0]
        assert (one.lengths[0], one.returns[0], one.terminated[0]) == (
            many.lengths[k],
            many.returns[k],
            many.terminated[k],
        )
        for name in ("observations", "actions", "rewards"):
            np.testing.assert_array_equal(getattr(one, name)[:, 0], getattr(many, name)[:steps, k])
    together.close()


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("env_name", ENVS)
@pytest.mark.parametrize("deterministic", [True, False])
def test_a_candidate_is_the_same_alone(env_name: str, deterministic: bool, threads: int) -> None:
    env = ENVS[env_name]()
    candidates = policies(env, EPISODES, deterministic)
    population = np.stack([candidate.vector() for candidate in candidates])
    numbers = np.arange(EPISODES)[:, None]
    together, alone = rollouts(env, threads), rollouts(env, 1)
    returns, lengths = together.evaluate(candidates[0], population, key=KEY, episodes=numbers)
    for k in range(0, EPISODES, 4):
        found = alone.evaluate(candidates[0], population[k : k + 1], key=KEY, episodes=numbers[k : k + 1])
        assert (found[0].item(), found[1].item()) == (returns[k, 0], lengths[k, 0])
    together.close()
