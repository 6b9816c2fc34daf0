"""What all finite POMDPs have in common, and what a policy that acts at random earns in each."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hydra import compose, initialize_config_module

import dpsearch.train  # noqa: F401  # registers the schemas
from dpsearch.env_kit import KernelVectorEnv
from dpsearch.pomdp import TabularEnv
from tests.support.exact import Values, at_random, play

IDS = {
    "cheese": "CheeseMaze",
    "maze4x3": "Maze4x3",
    "maze89": "Maze89",
    "shuttle": "ShuttleDocking",
    "tiger": "Tiger",
    "tmaze": "TMaze",
}
"""By name of the option in the configuration."""

VARIANTS: list[tuple[str, dict[str, Any]]] = [
    ("cheese", {}),
    ("cheese", {"start": "anywhere", "bump_reward": 0.0}),
    ("maze4x3", {}),
    ("maze4x3", {"minus_ends": True}),
    ("maze4x3", {"slips": "any_way", "minus_reward": -0.04}),
    ("maze89", {}),
    ("shuttle", {}),
    ("tiger", {}),
    ("tiger", {"single": True}),
    ("tmaze", {"corridor_length": 3}),
]


def made(name: str, **arguments: Any) -> TabularEnv:
    env = gym.make(f"dpsearch.envs:dpsearch/{IDS[name]}-v0", **arguments).unwrapped
    assert isinstance(env, TabularEnv)
    return env


def at_random_in(name: str, arguments: dict[str, Any]) -> Values:
    env = made(name, **arguments)
    return play(env.pomdp, at_random(env.pomdp), env.max_episode_steps)


@pytest.mark.parametrize(
    ("name", "arguments", "printed"),
    [
        ("tiger", {}, "-3033.333 -30.33333 -30.33333 -121.33333 100"),
        ("tiger", {"single": True}, "-45.50000 -30.33333 -36.68093 -40.44444 1.50000"),
        ("shuttle", {}, "-169.433 -0.16943 -0.16943 -2.23040 1000"),
        ("maze4x3", {}, "-1.96304 -0.06034 -0.00632 -1.96304 32.53076"),
        ("maze4x3", {"minus_ends": True}, "-1.09960 -0.05000 -0.09315 -1.09960 21.99209"),
        ("maze4x3", {"slips": "any_way", "minus_reward": -0.04}, "-0.79846 -0.01884 0.05619 -0.79846 42.37237"),
        ("cheese", {}, "-62.54944 -0.54318 -0.51973 -2.25099 115.15313"),
        ("cheese", {"start": "anywhere", "bump_reward": 0.0}, "0.99320 0.01038 0.06954 0.05933 95.70688"),
        ("tmaze", {"corridor_length": 3}, "0.05000 0.00156 0.05322 -0.10557 32.00000"),
        ("tmaze", {"corridor_length": 5}, "-2.15000 -0.02986 -0.00591 -1.19408 72.00000"),
        ("tmaze", {"corridor_length": 7}, "-5.14970 -0.04023 -0.02654 -1.88117 127.99152"),
        ("tmaze", {"corridor_length": 10}, "-11.08410 -0.04609 -0.03877 -2.41300 240.48076"),
        ("maze89", {}, "0.21972 0.00100 0.00842 0.05565 220.47499"),
    ],
)
def test_acting_at_random_earns_exactly_what_is_known(name: str, arguments: dict[str, Any], printed: str) -> None:
    """Return, reward per step, mean of the ratios of the episodes, discounted return, steps."""
    at_random_in(name, arguments).require(printed)


@pytest.mark.parametrize(("name", "arguments"), VARIANTS)
def test_playing_at_random_earns_what_is_expected(name: str, arguments: dict[str, Any]) -> None:
    n, expected = 1000, at_random_in(name, arguments)
    env = gym.make_vec(
        f"dpsearch.envs:dpsearch/{IDS[name]}-v0",
        num_envs=n,
        autoreset_mode=gym.vector.AutoresetMode.SAME_STEP,
        **arguments,
    )
    assert isinstance(env, KernelVectorEnv)
    env.reset(seed=0)
    env.action_space.seed(1)
    total, steps, alive = np.zeros(n), np.zeros(n), np.ones(n, np.bool_)
    while alive.any():
        observations, rewards, terminated, truncated, _ = env.step(env.action_space.sample())
        assert observations.dtype == np.float32
        total += rewards * alive
        steps += alive
        alive &= ~(terminated | truncated)
    assert steps.max() <= env.max_episode_steps
    for found, mean in ((total, expected.mean_return), (steps, expected.steps)):
        assert found.mean() == pytest.approx(mean, abs=4 * found.std() / np.sqrt(n) + 1e-9)


@pytest.mark.parametrize(("name", "arguments"), VARIANTS)
def test_gymnasiums_checks_pass(name: str, arguments: dict[str, Any]) -> None:
    check_env(made(name, **arguments), skip_render_check=True)


@pytest.mark.parametrize(("name", "arguments"), VARIANTS)
def test_everything_has_a_name_and_arguments_are_remembered(name: str, arguments: dict[str, Any]) -> None:
    env = made(name, **arguments)
    assert all(getattr(env, argument) == value for argument, value in arguments.items())
    if name != "tmaze":  # of which there may be two hundred thousand states
        assert len(set(env.pomdp.state_names)) == env.pomdp.n_states
    assert len(set(env.pomdp.action_names)) == env.pomdp.n_actions
    assert len(set(env.pomdp.observation_names)) == env.pomdp.n_symbols
    assert env.spec is not None
    again = gym.make(env.spec).unwrapped
    assert isinstance(again, TabularEnv)
    assert (again.pomdp.rewards == env.pomdp.rewards).all()


@pytest.mark.parametrize("name", IDS)
def test_the_configuration_agrees_with_the_class(name: str) -> None:
    with initialize_config_module("dpsearch.configs", version_base="1.3"):
        config = compose("train", overrides=[f"env={name}"]).env
    env = made(name)
    assert config.id == f"dpsearch.envs:dpsearch/{IDS[name]}-v0"
    assert config.gamma == env.pomdp.discount
    assert env.reward_threshold == gym.spec(config.id.partition(":")[2]).reward_threshold
    own = [key for key in config if key not in ("id", "gamma", "reward_threshold", "max_episode_steps")]
    assert [config[key] for key in own] == [getattr(env, key) for key in own]


@pytest.mark.parametrize("name", IDS)
def test_bad_arguments_common_to_all_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match="reveal must be one of state, belief, nothing, got 'all'"):
        made(name, reveal="all")
    with pytest.raises(ValueError, match="render_mode must be one of rgb_array, human, ansi, or None, got 'gif'"):
        type(made(name))(render_mode="gif")  # type: ignore[call-arg]
    with pytest.raises(ValueError, match="max_episode_steps must be at least 1, got 0"):
        type(made(name))(max_episode_steps=0)  # type: ignore[call-arg]
