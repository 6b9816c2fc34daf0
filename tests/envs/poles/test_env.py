from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from dpsearch.env_kit import HiddenState
from dpsearch.envs import DoublePole, DoublePoleHidden, SinglePole, SinglePoleHidden
from dpsearch.envs.poles.env import (
    TRACK,
    DoublePoleHiddenVector,
    DoublePoleVector,
    PolesEnv,
    generalisation_starts,
)
from dpsearch.kernels.lanes import LANES
from dpsearch.rollout import LaneEngine, make_rollouts
from tests.support.plain_poles import (
    BOTH,
    ENVS,
    SCALES,
    VECTORS,
    State,
    balance,
    fallen,
    state_of,
)


@pytest.mark.parametrize("kind", ENVS)
def test_an_episode_starts_with_the_long_pole_at_four_degrees(kind: type[PolesEnv]) -> None:
    env = kind()
    observation, info = env.reset(seed=3)
    assert info["state"].tolist() == [0, 0, 0.0700851, *[0] * (2 * env.poles - 1)]
    assert math.degrees(info["state"][2]) == pytest.approx(4.0156, abs=1e-4)
    shown = (info["state"] / SCALES[: len(info["state"])])[:: 1 if env.velocities else 2]
    np.testing.assert_array_equal(observation, shown.astype(np.float32))
    assert env.observation_space.shape == shown.shape
    assert env.kernel.draws == 0  # nothing here is random


@pytest.mark.parametrize("kind", [SinglePoleHidden, DoublePoleHidden])
def test_hidden_tasks_show_places_and_angles_only(kind: type[PolesEnv]) -> None:
    full = (SinglePole if kind.poles == 1 else DoublePole)()
    env = kind()
    env.reset(seed=0)
    full.reset(seed=0)
    for action in np.linspace(-0.3, 0.4, 5)[:, None]:
        np.testing.assert_array_equal(env.step(action)[0], full.step(action)[0][::2])


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize(
    ("kind", "number"), [(SinglePole, 0), (SinglePole, 2), (DoublePole, 0), (DoublePole, 2), (DoublePole, 4)]
)
def test_an_episode_ends_exactly_at_the_limits(kind: type[PolesEnv], number: int, side: int) -> None:
    """Bisects for the start from which one step leads right to the limit."""
    limit = TRACK if number == 0 else math.radians(12 if kind.poles == 1 else 36)

    def after(value: float) -> tuple[float, bool]:
        start = np.zeros(2 + 2 * kind.poles)
        start[number], start[number + 1] = side * value, side * 0.5
        env = kind(start_state=start)
        env.reset(seed=0)
        terminated = env.step(np.array([side * 0.01]))[2]
        return abs(float(state_of(env)[number])), terminated

    below, beyond = 0.5 * limit, limit
    for _ in range(60):
        middle = (below + beyond) / 2
        place, terminated = after(middle)
        assert terminated == (place > limit)
        below, beyond = (below, middle) if terminated else (middle, beyond)
    assert after(below)[0] <= limit < after(beyond)[0]
    assert after(beyond)[0] - after(below)[0] < 1e-12


def test_a_state_that_is_not_a_number_ends_the_episode() -> None:
    kernel = DoublePole().kernel
    state, reward, terminated = np.full((6, LANES), np.nan), np.empty(LANES), np.zeros(LANES, np.bool_)
    kernel.step(
        kernel.floats, kernel.ints, np.empty((0, LANES)), np.zeros((1, LANES)), state, reward, terminated, LANES
    )
    assert terminated.all()


@pytest.mark.parametrize("kind", ENVS)
def test_the_limit_is_100_000_steps_and_counts_as_solved(kind: type[PolesEnv]) -> None:
    name = f"dpsearch.envs:dpsearch/{kind.__name__}-v0"
    assert kind().max_episode_steps == kind().reward_threshold == 100_000
    assert gym.spec(name.split(":")[1]).reward_threshold == 100_000
    made = gym.make(name, max_episode_steps=500).unwrapped
    assert isinstance(made, kind)
    for rollouts in (make_rollouts(name), make_rollouts(kind), make_rollouts(gym.make_vec(name, num_envs=2))):
        assert isinstance(rollouts, LaneEngine)
        assert rollouts.max_steps == rollouts.reward_threshold == 100_000


@pytest.mark.parametrize(
    ("arguments", "limit", "threshold"),
    [
        ({"max_episode_steps": 200}, 200, 200),
        ({"reward": "failure"}, 100_000, 0),
        ({"reward": "failure", "max_episode_steps": 300}, 300, 0),
        ({"reward": "damping"}, 1000, None),
        ({"reward": "damping", "max_episode_steps": 2000}, 2000, None),
    ],
)
def test_the_threshold_is_the_return_of_never_falling(
    arguments: dict[str, Any], limit: int, threshold: float | None
) -> None:
    env, vector = DoublePole(**arguments), DoublePoleVector(3, **arguments)
    assert (env.max_episode_steps, env.reward_threshold) == (limit, threshold)
    assert (vector.max_episode_steps, vector.reward_threshold) == (limit, threshold)
    for bare in (env, vector):
        rollouts = make_rollouts(bare)
        assert (rollouts.max_steps, rollouts.reward_threshold) == (limit, threshold)
    spec = gym.spec("dpsearch/DoublePole-v0")
    env.spec, vector.spec = spec, spec  # what gym.make does in the end
    for made in (env, vector):
        assert made.spec is not None
        assert (made.spec.max_episode_steps, made.spec.reward_threshold) == (limit, threshold)
        assert make_rollouts(made).reward_threshold == threshold
    env.spec = None
    assert env.spec is None


# Rewards


@pytest.mark.parametrize(("reward", "total"), [("steps", 70.0), ("failure", -1.0)])
@BOTH
def test_rewards_of_an_episode_that_ends_with_a_fall(kind: type[PolesEnv], reward: str, total: float) -> None:
    env = kind(reward=reward)
    rewards, states, terminated = balance(env, shove=60)
    assert terminated
    assert len(rewards) > 60
    assert env.episode_return == (len(rewards) - 1 if reward == "steps" else total)
    assert set(rewards[:-1]) == {1.0 if reward == "steps" else 0.0}
    assert rewards[-1] == (0.0 if reward == "steps" else -1.0)
    assert [fallen(state) for state in states] == [False] * len(rewards) + [True]


@pytest.mark.parametrize(("reward", "total"), [("steps", 300.0), ("failure", 0.0)])
@BOTH
def test_rewards_of_an_episode_in_which_nothing_falls(kind: type[PolesEnv], reward: str, total: float) -> None:
    env = kind(reward=reward, max_episode_steps=300)
    rewards, _, terminated = balance(env)
    assert (len(rewards), terminated) == (300, False)
    assert env.episode_return == total == env.reward_threshold


def gruau(states: list[State]) -> float:
    """The damping fitness of an episode that went through these states before anything fell."""
    t = len(states) - 1
    calm = 0.0
    if t >= 100:
        calm = 0.75 / sum(np.abs(states[i][:4]).sum() for i in range(t - 100, t + 1))
    return 0.1 * t / 1000 + 0.9 * float(calm)


@pytest.mark.parametrize(
    ("limit", "shove"),
    [(1000, None), (100, None), (99, None), (101, None), (250, None), (1000, 30), (1000, 80), (1000, 600)],
)
@BOTH
def test_damping_rewards_add_up_to_gruaus_fitness(kind: type[PolesEnv], limit: int, shove: int | None) -> None:
    env = kind(reward="damping", max_episode_steps=limit, start_state=[0.5, 0.3, 0.02, *[0] * (2 * kind.poles - 1)])
    rewards, states, terminated = balance(env, shove)
    assert terminated == (shove is not None)
    survived = states[:-1] if terminated else states
    assert len(states) == (len(rewards) + 1 if terminated else limit + 1)
    totals = np.cumsum(rewards)
    for t in range(1, len(survived)):
        assert totals[t - 1] == pytest.approx(gruau(survived[: t + 1]), rel=1e-11)
    assert env.episode_return == pytest.approx(gruau(survived), rel=1e-11)
    assert rewards[-1] == 0 or not terminated
    assert (gruau(survived) > 0.2) == (len(survived) == 1001)  # calm pays
    again, _, _ = balance(env, shove)
    assert again == rewards  # nothing is left over from the episode before


def test_damping_shows_no_more_than_the_state() -> None:
    env = DoublePoleHidden(reward="damping")
    assert env.reset(seed=0)[1]["state"].shape == (6,)
    assert env.step(np.array([0.1]))[4]["state"].shape == (6,)
    vector = DoublePoleHiddenVector(3, reward="damping")
    assert vector.reset(seed=0)[1]["state"].shape == (3, 6)
    assert HiddenState(env).observation_space.shape == (6,)


# Start states


def test_the_625_starts_are_those_of_the_literature() -> None:
    for poles in (1, 2):
        starts = generalisation_starts(poles)
        assert starts.shape == (625, 2 + 2 * poles)
        assert len(np.unique(starts, axis=0)) == 625
        assert not starts[:, 4:].any()
        fractions = (0.05, 0.25, 0.5, 0.75, 0.95)
        expected = [
            (a * 4.32 - 2.16, b * 2.70 - 1.35, c * 0.12566304 - 0.06283152, d * 0.30019504 - 0.15009752)
            for a, b, c, d in itertools.product(fractions, repeat=4)
        ]  # in the digits that the programs of the time have
        np.testing.assert_allclose(starts[:, :4], expected, rtol=1e-5, atol=1e-9)
        assert (starts[312] == 0).all()
    with pytest.raises(ValueError, match="poles must be 1 or 2, got 3"):
        generalisation_starts(3)


@pytest.mark.parametrize(("kind", "vector"), list(zip(ENVS, VECTORS, strict=True)))
def test_generalisation_draws_one_of_the_625_starts_uniformly(kind: type[PolesEnv], vector: Any) -> None:
    starts = generalisation_starts(kind.poles)
    drawn = vector(20_000, start_state="generalisation").reset(seed=0)[1]["state"]
    rows, counts = np.unique(drawn, axis=0, return_counts=True)
    np.testing.assert_array_equal(rows, np.unique(starts, axis=0))
    assert ((counts - 32) ** 2 / 32).sum() < 624 + 5 * math.sqrt(2 * 624)  # chi-squared
    env = kind(start_state="generalisation")
    first = [env.reset(seed=7 if k == 0 else None)[1]["state"].tolist() for k in range(3)]
    assert len({tuple(state) for state in first}) == 3
    assert env.reset(seed=7)[1]["state"].tolist() == first[0]


def test_rows_of_starts_are_drawn_from_and_a_single_one_is_taken_as_it_is() -> None:
    start = [0.1, -0.2, 0.03, -0.04, 0.05, 0.06]
    assert DoublePole(start_state=start).reset(seed=0)[1]["state"].tolist() == start
    other = (-np.array(start)).tolist()
    states = DoublePoleVector(50, start_state=[start, other]).reset(seed=0)[1]["state"]
    assert sorted(np.unique(states, axis=0).tolist()) == sorted([start, other])


@pytest.mark.parametrize("kind", [DoublePole, DoublePoleVector])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"reward": "step"}, "reward must be one of steps, failure, damping, got 'step'"),
        ({"cart_friction": -0.1}, "cart_friction must be finite and at least 0, got -0.1"),
        ({"cart_friction": math.inf}, "cart_friction must be finite and at least 0, got inf"),
        ({"cart_friction": "much"}, "cart_friction must be finite and at least 0, got 'much'"),
        ({"max_episode_steps": 0}, "max_episode_steps must be at least 1, got 0"),
        ({"start_state": "anywhere"}, "start_state must be 6 numbers, .*, got 'anywhere'"),
        ({"start_state": [0, 0, 0.07, 0]}, "start_state must be 6 numbers, .*, got"),
        ({"start_state": []}, "start_state must be 6 numbers, .*, got"),
        ({"start_state": [[[0.0] * 6]]}, "start_state must be 6 numbers, .*, got"),
        ({"start_state": [[0.0] * 6, [0.0] * 4]}, "start_state must be 6 numbers, .*, got"),
        ({"start_state": [2.5, 0, 0, 0, 0, 0]}, "start_state must be within 2.4, 10, 0.6283, 10, 0.6283, 10"),
        ({"start_state": [0, 0, 0.7, 0, 0, 0]}, "start_state must be within"),
        ({"start_state": [0, 0, 0, 0, 0, 11]}, "start_state must be within"),
        ({"start_state": [0, 0, math.nan, 0, 0, 0]}, "start_state must be within"),
    ],
)
def test_bad_arguments_are_refused(kind: Callable[..., Any], arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        kind(**arguments)


def test_an_action_of_the_wrong_shape_is_refused() -> None:
    env = SinglePole()
    env.reset(seed=0)
    for action in (0.5, [0.5, 0.5], [math.nan]):
        with pytest.raises(ValueError, match="action"):
            env.step(action)


# Drawing
