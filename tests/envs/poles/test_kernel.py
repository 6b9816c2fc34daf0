"""The dynamics of the poles, against a plain simulation, scipy, and the conservation of energy."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpsearch.envs import DoublePole, SinglePole
from dpsearch.envs.poles.env import (
    PolesEnv,
)
from dpsearch.envs.poles.kernel import _sincos
from tests.support.plain_poles import (
    BOTH,
    SCALES,
    derivative,
    energy,
    fallen,
    plain_force,
    plain_step,
    random_start,
    state_of,
)


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
