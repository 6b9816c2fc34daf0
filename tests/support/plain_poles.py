"""Carts and poles once more, straight from the equations of motion, and a controller that balances them."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from dpsearch.envs import DoublePole, DoublePoleHidden, SinglePole, SinglePoleHidden
from dpsearch.envs.poles.env import (
    LEAN,
    TRACK,
    DoublePoleHiddenVector,
    DoublePoleVector,
    PolesEnv,
    SinglePoleHiddenVector,
    SinglePoleVector,
)

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
