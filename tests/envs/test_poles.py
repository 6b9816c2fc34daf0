from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import solve_discrete_are

from dpsearch.envs import DoublePole, DoublePoleHidden, HiddenState, SinglePole, SinglePoleHidden
from dpsearch.envs.poles import (
    LEAN,
    TRACK,
    DoublePoleHiddenVector,
    DoublePoleVector,
    PolesEnv,
    SinglePoleHiddenVector,
    SinglePoleVector,
    generalisation_starts,
)
from dpsearch.envs.poles_kernel import _sincos
from dpsearch.kernels.lanes import LANES
from dpsearch.rollout import CompiledRollouts, make_rollouts

State = NDArray[np.float64]
ENVS: list[type[PolesEnv]] = [SinglePole, SinglePoleHidden, DoublePole, DoublePoleHidden]
VECTORS = [SinglePoleVector, SinglePoleHiddenVector, DoublePoleVector, DoublePoleHiddenVector]
BOTH = pytest.mark.parametrize("kind", [SinglePole, DoublePole])

MASSES, HALVES = (0.1, 0.01), (0.5, 0.05)
SCALES = np.array([4.8, 2.0, 0.52, 2.0, 0.52, 2.0])


def derivative(state: State, force: float, cart_friction: float = 0.0) -> State:
    """The equations of motion from the Lagrangian of uniform rods on a cart, as a linear system of accelerations."""
    v, poles = state[1], len(state) // 2 - 1
    matrix, forces = np.zeros((1 + poles, 1 + poles)), np.zeros(1 + poles)
    matrix[0, 0], forces[0] = 1.0, force - cart_friction * np.sign(v)
    for i, (m, half) in enumerate(zip(MASSES[:poles], HALVES, strict=False), start=1):
        angle, rate = state[2 * i : 2 * i + 2]
        matrix[0, 0] += m
        matrix[0, i] = matrix[i, 0] = m * half * np.cos(angle)
        matrix[i, i] = m * half**2 + m * (2 * half) ** 2 / 12  # Steiner: of the centre of mass, and around it
        forces[0] += m * half * rate**2 * np.sin(angle)
        forces[i] = m * 9.8 * half * np.sin(angle) - 2e-6 * rate
    accelerations = np.linalg.solve(matrix, forces)
    return np.column_stack([state[1::2], accelerations]).ravel()


def energy(state: State) -> float:
    total = 0.5 * state[1] ** 2
    for m, half, angle, rate in zip(MASSES, HALVES, state[2::2], state[3::2], strict=False):
        across, along = state[1] + half * rate * math.cos(angle), -half * rate * math.sin(angle)
        total += 0.5 * m * (across**2 + along**2) + 0.5 * m * (2 * half) ** 2 / 12 * rate**2
        total += m * 9.8 * half * math.cos(angle)
    return float(total)


def plain_force(action: float) -> float:
    force = 10.0 * max(-1.0, min(1.0, action))
    if abs(force) < 10 / 256:
        force = -10 / 256 if force < 0 else 10 / 256
    return force


def plain_step(state: State, action: float, cart_friction: float = 0.0) -> State:
    """Two steps of the textbook's Runge and Kutta."""
    force, h = plain_force(action), 0.01
    for _ in range(2):
        k1 = derivative(state, force, cart_friction)
        k2 = derivative(state + h / 2 * k1, force, cart_friction)
        k3 = derivative(state + h / 2 * k2, force, cart_friction)
        k4 = derivative(state + h * k3, force, cart_friction)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return state


def fallen(state: State) -> bool:
    lean = math.radians(12 if len(state) == 4 else 36)
    return bool(abs(state[0]) > 2.4 or (np.abs(state[2::2]) > lean).any())


def random_start(random: np.random.Generator, poles: int, share: float = 0.8) -> State:
    largest = np.array([TRACK, 2.0, *[LEAN[poles], 2.0] * poles])
    return share * largest * random.uniform(-1, 1, 2 + 2 * poles)


def state_of(env: PolesEnv) -> State:
    return env.kernel_state()[: 2 + 2 * env.poles]


@cache
def gains(poles: int) -> State:
    """A linear controller that balances: the optimal one for the motion near the top."""
    size, step = 2 + 2 * poles, 1e-5
    columns = [(plain_step(row, 0.1) - plain_step(-row, 0.1)) / (2 * step) for row in step * np.eye(size)]
    a, zero = np.column_stack(columns), np.zeros(size)
    b = ((plain_step(zero, 0.2) - plain_step(zero, 0.1)) / 0.1)[:, None]
    p = solve_discrete_are(a, b, np.eye(size), np.eye(1))
    optimal: State = (np.linalg.solve(1 + b.T @ p @ b, b.T @ p @ a))[0]
    return optimal


def balance(env: PolesEnv, shove: int | None = None) -> tuple[list[float], list[State], bool]:
    """Rewards and states of an episode of the controller, which from step ``shove`` on pushes to the right only."""
    env.reset(seed=0)
    rewards: list[float] = []
    states = [state_of(env)]
    over = False
    while not over:
        push = shove is not None and len(rewards) >= shove
        action = 1.0 if push else float(np.clip(-gains(env.poles) @ states[-1], -1, 1))
        _, reward, terminated, truncated, _ = env.step(np.array([action]))
        rewards.append(reward)
        states.append(state_of(env))
        over = terminated or truncated
    return rewards, states, terminated


# Physics


@pytest.mark.parametrize("cart_friction", [0.0, 5e-4, 0.3])
@BOTH
def test_every_step_is_that_of_a_plain_simulation(kind: type[PolesEnv], cart_friction: float) -> None:
    random = np.random.default_rng(1)
    steps, ends = 0, 0
    for _ in range(40):
        start = random_start(random, kind.poles)
        env = kind(start_state=start, cart_friction=cart_friction)
        env.reset(seed=0)
        for _ in range(60):
            before, action = state_of(env), random.normal(scale=0.7)
            expected = plain_step(before, action, cart_friction)
            observation, reward, terminated, truncated, info = env.step(np.array([action]))
            np.testing.assert_allclose(info["state"], expected, rtol=1e-12, atol=1e-13)
            np.testing.assert_allclose(observation, expected / SCALES[: len(expected)], rtol=1e-6, atol=1e-7)
            assert (terminated, reward, truncated) == (fallen(expected), float(not fallen(expected)), False)
            steps, ends = steps + 1, ends + terminated
            if terminated:
                break
    assert steps > 200
    assert ends > 10


@pytest.mark.parametrize(("kind", "accuracy"), [(SinglePole, 3e-8), (DoublePole, 2e-5)])
def test_a_step_is_close_to_the_exact_motion(kind: type[PolesEnv], accuracy: float) -> None:
    """As close as Runge and Kutta get in 0.01 s, while the short pole falls by a factor e in 0.06 s."""
    random = np.random.default_rng(2)
    for action in random.uniform(-1, 1, 30):
        start = random_start(random, kind.poles)
        env = kind(start_state=start)
        env.reset(seed=0)
        env.step(np.array([action]))
        force, options = plain_force(action), {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
        exact = solve_ivp(lambda _, s, f=force: derivative(s, f), (0.0, 0.02), start, **options).y[:, -1]
        np.testing.assert_allclose(state_of(env), exact, rtol=0, atol=accuracy)


@pytest.mark.parametrize("cart_friction", [0.0, 0.2])
@pytest.mark.parametrize(("kind", "accuracy"), [(SinglePole, 1e-8), (DoublePole, 2e-6)])
def test_energy_changes_by_the_work_of_force_and_friction_alone(
    kind: type[PolesEnv], accuracy: float, cart_friction: float
) -> None:
    random = np.random.default_rng(3)
    compared = 0
    for action in random.uniform(-1, 1, 60):
        env = kind(start_state=random_start(random, kind.poles), cart_friction=cart_friction)
        env.reset(seed=0)
        before = state_of(env)
        env.step(np.array([action]))
        after = state_of(env)
        if before[1] * after[1] < 0:
            continue  # the cart turns round on its way
        force = plain_force(action) - cart_friction * np.sign(before[1])
        lost_in_hinges = 2e-6 * ((before[3::2] ** 2 + after[3::2] ** 2) / 2).sum() * 0.02
        work = force * (after[0] - before[0]) - lost_in_hinges
        assert energy(after) - energy(before) == pytest.approx(work, abs=accuracy)
        compared += 1
    assert compared > 20


def test_sine_and_cosine_are_accurate_for_all_angles_that_occur() -> None:
    x = np.linspace(-1.25, 1.25, 100_001)
    exact = x.astype(np.longdouble)
    s, c = _sincos.py_func(x)
    assert np.abs(s - np.sin(exact)).max() < 5e-16
    assert np.abs(c - np.cos(exact)).max() < 1.5e-15
    assert np.abs(s - np.sin(exact))[np.abs(x) < 1e-3].max() < 1e-18


def test_no_angle_gets_beyond_where_the_sine_is_accurate() -> None:
    """Not even when full force swings the short pole from one side to the other."""
    largest = 0.0
    for side, spin in itertools.product([-1.0, 1.0], [-10.0, 0.0, 10.0]):
        env = DoublePole(start_state=[0.0, 0.0, 0.0, spin, side * 0.6, -side * 10.0])
        env.reset(seed=0)
        terminated = False
        while not terminated:
            terminated = env.step(np.array([side]))[2]
            largest = max(largest, np.abs(state_of(env)[2::2]).max())
    assert 0.7 < largest < 1.25


# Force, start, ends, limits


@pytest.mark.parametrize(
    ("action", "same_as"),
    [
        (0.0, 1 / 256),
        (-0.0, 1 / 256),
        (1e-9, 1 / 256),
        (-1e-9, -1 / 256),
        (1.5, 1.0),
        (-700.0, -1.0),
        (0.99 / 256, 1 / 256),
    ],
)
@BOTH
def test_the_force_is_at_least_10_over_256_and_at_most_10_newtons(
    kind: type[PolesEnv], action: float, same_as: float
) -> None:
    states = []
    for a in (action, same_as):
        env = kind()
        env.reset(seed=0)
        env.step(np.array([a]))
        states.append(state_of(env).tolist())
    assert states[0] == states[1]
    assert plain_force(action) == 10.0 * same_as


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
    kernel.step(kernel.floats, kernel.ints, np.empty((0, LANES)), np.zeros((1, LANES)), state, reward, terminated)
    assert terminated.all()


@pytest.mark.parametrize("kind", ENVS)
def test_the_limit_is_100_000_steps_and_counts_as_solved(kind: type[PolesEnv]) -> None:
    name = f"dpsearch.envs:dpsearch/{kind.__name__}-v0"
    assert kind().max_episode_steps == kind().reward_threshold == 100_000
    assert gym.spec(name.split(":")[1]).reward_threshold == 100_000
    made = gym.make(name, max_episode_steps=500).unwrapped
    assert isinstance(made, kind)
    for rollouts in (make_rollouts(name), make_rollouts(kind), make_rollouts(gym.make_vec(name, num_envs=2))):
        assert isinstance(rollouts, CompiledRollouts)
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


@pytest.mark.parametrize("render_mode", [None, "rgb_array", "human", "ansi"])
@pytest.mark.parametrize("kind", ENVS)
def test_gymnasiums_checks_pass_in_every_render_mode(
    kind: type[PolesEnv], render_mode: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setitem(PolesEnv.metadata, "render_fps", 1000)
    env = gym.make(f"dpsearch.envs:dpsearch/{kind.__name__}-v0", render_mode=render_mode)
    check_env(env.unwrapped)
    env.close()


def test_checks_pass_with_every_reward_and_many_starts() -> None:
    for reward in ("failure", "damping"):
        check_env(DoublePoleHidden(reward=reward, start_state="generalisation"), skip_render_check=True)


def picture(env: PolesEnv) -> NDArray[np.uint8]:
    frame = env.render()
    assert isinstance(frame, np.ndarray)
    assert (frame.shape, frame.dtype) == ((540, 960, 3), np.uint8)
    return frame


@pytest.mark.parametrize("kind", ENVS)
def test_pictures_show_what_goes_on(kind: type[PolesEnv]) -> None:
    env = kind(render_mode="rgb_array")
    env.reset(seed=0)
    frames = [picture(env)]
    for action in (0.4, 0.4, -0.9):
        env.step(np.array([action]))
        frames.append(picture(env))
        np.testing.assert_array_equal(picture(env), frames[-1])
    for one, two in itertools.combinations(frames, 2):
        assert (one != two).any()


def test_falls_of_all_kinds_can_be_drawn() -> None:
    ends = {
        "The long pole leans by more than 36°": [0, 0, 0.62, 2, 0, 0],
        "The short pole leans by more than 36°": [0, 0, 0, 0, -0.62, -9],
        "The cart has left the track in step 1.": [-2.39, -9, 0, 0, 0, 0],
    }
    for message, start in ends.items():
        env = DoublePole(start_state=start, render_mode="rgb_array")
        env.reset(seed=0)
        assert env.view().message()[0] == "The start."
        before = picture(env)
        assert env.step(np.array([0.0]))[2]
        assert message in env.text()
        assert (picture(env) != before).any()
    single = SinglePole(max_episode_steps=1)
    single.reset(seed=0)
    assert "everything is at rest" in single.text()
    single.step(np.array([0.0]))
    assert "Balanced to the end." in single.text()


def test_text_tells_place_angles_force_and_what_is_seen() -> None:
    env = DoublePoleHidden(render_mode="ansi", start_state=[1.2, 0, 0.1, 0, -0.2, 0])
    env.reset(seed=0)
    sketch = env.render()
    assert isinstance(sketch, str)
    track, cart, seen, time = sketch.splitlines()
    assert track.index("A") == 1 + round(0.75 * 47)
    assert "long pole / +5.73°, short pole \\ -11.46°, force none" in cart
    assert seen.strip() == "sees +0.2500 +0.1923 -0.3846, no velocities"
    assert time.strip() == "0 of 100,000 steps, 0.00 s, return 0"
    env.step(np.array([0.0]))
    assert "force +0.04 N" in env.render()
    assert "Balanced for 1 step, 0.02 seconds." in env.render()
    full = DoublePole(start_state=[1.2, 0.5, 0.1, 0, -0.2, 0])
    full.reset(seed=0)
    assert "sees +0.2500 +0.2500 +0.1923 +0.0000 -0.3846 +0.0000\n" in full.text()
