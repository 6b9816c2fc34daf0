"""The motion of one or two poles on a cart, compiled for lanes.

Wieland's equations, as Gomez and Miikkulainen use them. A force F pushes the cart, which has the velocity v; pole i
leans by the angle a_i and turns with the angular velocity w_i::

    pull_i = hinge friction * w_i / (m_i l_i) + g sin a_i
    push_i = m_i l_i w_i^2 sin a_i + 3/4 m_i cos a_i pull_i
    dv/dt   = (F - cart friction * sign v + sum of push_i) / (M + sum of m_i (1 - 3/4 cos^2 a_i))
    dw_i/dt = -3 / (4 l_i) (dv/dt cos a_i + pull_i)

Fourth-order Runge and Kutta integrates them. As the derivatives of places are velocities, and the derivatives of
velocities are accelerations, the four stages can be written in terms of accelerations, which saves half of the
bookkeeping.

The state of a lane is (x, v, a_1, w_1) or (x, v, a_1, w_1, a_2, w_2), in metres, radians and seconds. For the damping
fitness there follow the steps survived, the fitness so far, and the motion in each of the last 101 states.

Source: A. P. Wieland, "Evolving neural network controllers for unstable systems", IJCNN 1991, as in F. Gomez and
R. Miikkulainen, "Incremental evolution of complex general behavior", Adaptive Behavior 5, 1997.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dpsearch.kernels.lanes import FASTMATH, LANES, EnvKernel
from dpsearch.kernels.on_demand import on_demand

GRAVITY: Final = -9.8  # m/s^2
CART_MASS: Final = 1.0  # kg
MASS_1: Final = 0.1  # kg
MASS_2: Final = 0.01
HALF_LENGTH_1: Final = 0.5  # m
HALF_LENGTH_2: Final = 0.05
HINGE_FRICTION: Final = 2e-6  # kg m^2/s
LARGEST_FORCE: Final = 10.0  # N
SMALLEST_FORCE: Final = 10.0 / 256.0
TIME_STEP: Final = 0.01  # s, two to an action

DAMPING_STEPS: Final = 100
"""Steps over whose states Gruau's fitness sums up motion; an episode must last so long before any of it counts."""

_WINDOW: Final = DAMPING_STEPS + 1  # from i = t - 100 to t

_HALF: Final = 0.5 * TIME_STEP
_SIXTH: Final = TIME_STEP / 6.0
_SQUARE_2: Final = TIME_STEP**2 / 2.0
_SQUARE_4: Final = TIME_STEP**2 / 4.0
_SQUARE_6: Final = TIME_STEP**2 / 6.0
_S: Final = (  # (sin x - x) / x^3 as a polynomial in x^2 that interpolates at Chebyshev's nodes up to 1.25
    -0.16666666666666666,
    0.008333333333332851,
    -0.00019841269840776478,
    2.755731903444393e-06,
    -2.505207369721675e-08,
    1.6055782815851143e-10,
    -7.494895594805586e-13,
)
_C: Final = (  # (cos x - 1 + x^2 / 2) / x^4 as a polynomial in x^2, by the same nodes
    0.04166666666666633,
    -0.0013888888888734768,
    2.4801587186468036e-05,
    -2.75572877648166e-07,
    2.087286837540433e-09,
    -1.1248839301766352e-11,
)

_DAMPING_ROWS: Final = 2 + _WINDOW  # steps survived, fitness so far, motion in each of the last states
_STARTS, _DAMPING, _SEEN, _SEEN_ROWS = 0, 1, 2, 3  # in `ints`: number of starts, a flag, number of rows seen, those
_TRACK, _LEAN, _SURVIVED, _FAILED, _FRICTION, _SCALES = 0, 1, 2, 3, 4, 5  # in `floats`: behind the scales, the starts

# Inlined by LLVM, not by Numba (inline="always"): as fast in the end, and compiled in a fifth of the time.
_inline = njit(forceinline=True, fastmath=FASTMATH, error_model="numpy")


@_inline
def _sincos(x):
    """``(sin x, cos x)``, absolute error about 1e-15 for ``|x|`` up to 1.25, which no step of an episode reaches.

    Faster than ``elementary.sincos``: the argument is not reduced, and fewer operations wait for one another.
    """
    z = x * x
    z2 = z * z
    z4 = z2 * z2
    s = (_S[0] + z * _S[1]) + z2 * (_S[2] + z * _S[3]) + z4 * ((_S[4] + z * _S[5]) + z2 * _S[6])
    c = (_C[0] + z * _C[1]) + z2 * (_C[2] + z * _C[3]) + z4 * (_C[4] + z * _C[5])
    s, c = x + (x * z) * s, (1.0 - 0.5 * z) + z2 * c
    return s, c


@_inline
def applied_force(action):
    """Force (N) for an action in [-1, 1], never weaker than the smallest force."""
    force = LARGEST_FORCE * min(max(action, -1.0), 1.0)
    smallest = SMALLEST_FORCE if force >= 0.0 else -SMALLEST_FORCE
    return smallest if abs(force) < SMALLEST_FORCE else force


@_inline
def _drag(v, friction):
    """The friction of the cart, ``friction * sign v``. Where ``friction`` is a literal 0, nothing is left of it."""
    return friction if v > 0.0 else (-friction if v < 0.0 else 0.0)


@_inline
def _pole(a, w, mass, half_length):
    """Effect of a pole on the cart: ``cos a``, its pull, its push, and its share of the mass to be moved."""
    s, c = _sincos(a)
    pull = HINGE_FRICTION / (mass * half_length) * w + GRAVITY * s
    push = (mass * half_length * s) * (w * w) + (0.75 * mass) * (c * pull)
    return c, pull, push, 0.75 * mass * (s * s)  # the constant rest, m/4, is added below


@_inline
def _one(v, a, w, force, friction):
    """The accelerations (dv/dt, dw/dt) with one pole."""
    c, pull, push, moved = _pole(a, w, MASS_1, HALF_LENGTH_1)
    acceleration = (force - _drag(v, friction) + push) / ((CART_MASS + 0.25 * MASS_1) + moved)
    return acceleration, (-0.75 / HALF_LENGTH_1) * (acceleration * c + pull)


@_inline
def _two(v, a, w, b, u, force, friction):
    """The accelerations (dv/dt, dw/dt, du/dt) with two poles, the second one at angle b with velocity u."""
    c1, pull1, push1, moved1 = _pole(a, w, MASS_1, HALF_LENGTH_1)
    c2, pull2, push2, moved2 = _pole(b, u, MASS_2, HALF_LENGTH_2)
    mass = (CART_MASS + 0.25 * (MASS_1 + MASS_2)) + moved1 + moved2
    acceleration = (force - _drag(v, friction) + push1 + push2) / mass
    turn1 = (-0.75 / HALF_LENGTH_1) * (acceleration * c1 + pull1)
    return acceleration, turn1, (-0.75 / HALF_LENGTH_2) * (acceleration * c2 + pull2)


@_inline
def _stage_2(p, v):
    return p + _HALF * v


@_inline
def _stage_3(p, v, d1):
    return p + _HALF * v + _SQUARE_4 * d1


@_inline
def _stage_4(p, v, d2):
    return p + TIME_STEP * v + _SQUARE_2 * d2


@_inline
def _integral(p, v, d1, d2, d3, d4):
    """Position and velocity one time step on, from the accelerations at the four stages."""
    return p + TIME_STEP * v + _SQUARE_6 * (d1 + d2 + d3), v + _SIXTH * (d1 + 2.0 * (d2 + d3) + d4)


@_inline
def _advance_one(x, v, a, w, force, friction):
    """One time step of one pole."""
    v1, w1 = _one(v, a, w, force, friction)
    v2, w2 = _one(v + _HALF * v1, _stage_2(a, w), w + _HALF * w1, force, friction)
    v3, w3 = _one(v + _HALF * v2, _stage_3(a, w, w1), w + _HALF * w2, force, friction)
    v4, w4 = _one(v + TIME_STEP * v3, _stage_4(a, w, w2), w + TIME_STEP * w3, force, friction)
    x, v = _integral(x, v, v1, v2, v3, v4)
    a, w = _integral(a, w, w1, w2, w3, w4)
    return x, v, a, w


@_inline
def _advance_two(x, v, a, w, b, u, force, friction):
    """One time step of two poles."""
    v1, w1, u1 = _two(v, a, w, b, u, force, friction)
    v2, w2, u2 = _two(v + _HALF * v1, _stage_2(a, w), w + _HALF * w1, _stage_2(b, u), u + _HALF * u1, force, friction)
    v3, w3, u3 = _two(
        v + _HALF * v2, _stage_3(a, w, w1), w + _HALF * w2, _stage_3(b, u, u1), u + _HALF * u2, force, friction
    )
    v4, w4, u4 = _two(
        v + TIME_STEP * v3,
        _stage_4(a, w, w2),
        w + TIME_STEP * w3,
        _stage_4(b, u, u2),
        u + TIME_STEP * u3,
        force,
        friction,
    )
    x, v = _integral(x, v, v1, v2, v3, v4)
    a, w = _integral(a, w, w1, w2, w3, w4)
    b, u = _integral(b, u, u1, u2, u3, u4)
    return x, v, a, w, b, u


# In the loops below, rows are parts of one flat array: only so can LLVM see that they do not overlap.


@_inline
def _step_one(floats, friction, action, state, reward, terminated, lanes):
    track, lean, survived, failed = floats[_TRACK], floats[_LEAN], floats[_SURVIVED], floats[_FAILED]
    for i in range(lanes):
        x, v, a, w = state[i], state[LANES + i], state[2 * LANES + i], state[3 * LANES + i]
        force = applied_force(action[i])
        x, v, a, w = _advance_one(x, v, a, w, force, friction)
        x, v, a, w = _advance_one(x, v, a, w, force, friction)
        state[i], state[LANES + i], state[2 * LANES + i], state[3 * LANES + i] = x, v, a, w
        stands = (abs(x) <= track) & (abs(a) <= lean)  # not so if something is not a number
        reward[i] = survived if stands else failed
        terminated[i] = not stands


@_inline
def _step_two(floats, friction, action, state, reward, terminated, lanes):
    track, lean, survived, failed = floats[_TRACK], floats[_LEAN], floats[_SURVIVED], floats[_FAILED]
    for i in range(lanes):
        x, v, a, w = state[i], state[LANES + i], state[2 * LANES + i], state[3 * LANES + i]
        b, u = state[4 * LANES + i], state[5 * LANES + i]
        force = applied_force(action[i])
        x, v, a, w, b, u = _advance_two(x, v, a, w, b, u, force, friction)
        x, v, a, w, b, u = _advance_two(x, v, a, w, b, u, force, friction)
        state[i], state[LANES + i], state[2 * LANES + i], state[3 * LANES + i] = x, v, a, w
        state[4 * LANES + i], state[5 * LANES + i] = b, u
        stands = (abs(x) <= track) & (abs(a) <= lean) & (abs(b) <= lean)
        reward[i] = survived if stands else failed
        terminated[i] = not stands


@_inline
def _motion(state, i):
    """Motion in Gruau's sense: ``|x| + |v| + |a_1| + |w_1|``."""
    return abs(state[i]) + abs(state[LANES + i]) + abs(state[2 * LANES + i]) + abs(state[3 * LANES + i])


@_inline
def _damping(size, state, reward, terminated, lanes):
    """Pays each step what it adds to Gruau's fitness; ``size`` is the number of rows before the fitness's own."""
    steps, fitness, window = size * LANES, (size + 1) * LANES, (size + 2) * LANES
    for i in range(lanes):
        state[steps + i] += 1.0
        row = np.uint64(state[steps + i]) % np.uint64(_WINDOW)  # the oldest makes room for the newest
        state[np.uint64(window + i) + np.uint64(LANES) * row] = _motion(state, i)
    for i in range(lanes):
        reward[i] = state[window + i]
    # Summed anew at every step, for a running sum would drown small motions in the rounding of large ones before them.
    for first in range(window + LANES, window + _WINDOW * LANES, 4 * LANES):  # by fours, to go less often to memory
        for i in range(first, first + lanes):
            four = (state[i] + state[LANES + i]) + (state[2 * LANES + i] + state[3 * LANES + i])
            reward[i - first] += four
    for i in range(lanes):
        t = state[steps + i]
        calm = 0.75 / reward[i] if t >= DAMPING_STEPS else 0.0
        value = 0.1 * (t / 1000.0) + 0.9 * calm
        reward[i] = 0.0 if terminated[i] else value - state[fitness + i]
        state[fitness + i] = value


@on_demand()
def reset(floats, ints, noise, lane, state):
    """Puts one lane at one of the starts, all equally likely. With only one, no random number is needed."""
    starts = ints[_STARTS]
    row = np.int64(noise[0, lane] * starts) if starts > 1 else 0
    damping = ints[_DAMPING]
    size = state.shape[0] - _DAMPING_ROWS * damping
    for i in range(size):
        state[i, lane] = floats[_SCALES + size * (1 + row) + i]
    for i in range(size, state.shape[0]):
        state[i, lane] = 0.0
    if damping:
        state[size + 2, lane] = _motion(state.ravel(), lane)


@on_demand()
def observe(floats, ints, state, observation, lanes):
    """Shows the rows that the agent may see, scaled."""
    for i in range(ints[_SEEN]):
        row = ints[_SEEN_ROWS + i]
        scale = floats[_SCALES + row]
        for lane in range(lanes):
            observation[i, lane] = scale * state[row, lane]


@on_demand(fastmath=FASTMATH)
def step_one(floats, ints, noise, action, state, reward, terminated, lanes):
    """Two time steps of one pole in the first lanes."""
    actions, flat = action.ravel(), state.ravel()
    if floats[_FRICTION] == 0.0:
        _step_one(floats, 0.0, actions, flat, reward, terminated, lanes)
    else:
        _step_one(floats, floats[_FRICTION], actions, flat, reward, terminated, lanes)
    if ints[_DAMPING]:
        _damping(4, flat, reward, terminated, lanes)


@on_demand(fastmath=FASTMATH)
def step_two(floats, ints, noise, action, state, reward, terminated, lanes):
    """Two time steps of two poles in the first lanes."""
    actions, flat = action.ravel(), state.ravel()
    if floats[_FRICTION] == 0.0:
        _step_two(floats, 0.0, actions, flat, reward, terminated, lanes)
    else:
        _step_two(floats, floats[_FRICTION], actions, flat, reward, terminated, lanes)
    if ints[_DAMPING]:
        _damping(6, flat, reward, terminated, lanes)


def pack(
    starts: NDArray[np.float64],
    limits: tuple[float, float],
    rewards: tuple[float, float] | None,
    cart_friction: float,
    scales: Sequence[float],
    seen: Sequence[int],
) -> EnvKernel:
    """The kernel of a task.

    Args:
        starts: States in which an episode may begin ``(n, 4)`` for one pole, ``(n, 6)`` for two.
        limits: Largest distance of the cart from the middle (m), and largest angle of a pole (rad).
        rewards: Rewards of a step survived, and of a step in which something falls; None for Gruau's damping fitness.
        cart_friction: Force that brakes a moving cart (N).
        scales: Divisors of the numbers of the state, which give the observations.
        seen: Indices of the numbers of the state that are observed.
    """
    size = starts.shape[1]
    survived, failed = rewards or (0.0, 0.0)
    parameters = [*limits, survived, failed, cart_friction, *(1.0 / scale for scale in scales)]
    return EnvKernel(
        reset=reset,
        observe=observe,
        step=step_one if size == 4 else step_two,
        floats=np.concatenate([parameters, starts.ravel()]),
        ints=np.array([len(starts), rewards is None, len(seen), *seen], np.int64),
        state_size=size + (_DAMPING_ROWS if rewards is None else 0),
        observation_size=len(seen),
        draws=1 if len(starts) > 1 else 0,
    )
