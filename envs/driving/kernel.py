"""Driving on a closed road, compiled for lanes: the car's motion, the rules and the observations.

The car's place is that of its centre of mass along the middle line of the road, to the left of it, and the angle
between the car and the line, so the nearest point of the road need never be looked for; see ``motion.py``. Walls on
both sides, beyond the verge, stop what moves towards them.
"""

from __future__ import annotations

import math
from dataclasses import astuple
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from dpsearch.envs.driving.car import GRAVITY, Car
from dpsearch.envs.driving.motion import advance, within
from dpsearch.envs.driving.rays import free_road
from dpsearch.envs.driving.roads import Shape
from dpsearch.envs.driving.rules import (
    KMH,
    OBSERVATIONS,
    OFF_ROAD_REWARD,
    PEDALS_START,
    RAY_ANGLES,
    REWARDS,
    STANDING,
    STUCK_REWARD,
    Rules,
)
from dpsearch.kernels.elementary import arctan2, sincos
from dpsearch.kernels.lanes import FASTMATH, LANES, EnvKernel
from dpsearch.kernels.on_demand import on_demand

(DISTANCE, OFFSET, ANGLE, FORWARD, SIDEWAYS, TURNING, WHEELS, DRIVEN) = range(8)
"""Rows of the state: s, n, p, u, v, r and d of the car (m, rad, s), and steps driven."""
HIDDEN: Final = 8
"""Number of rows that are the hidden state; the other rows are kept for the rules, or follow from it."""
PROGRESS, LAPS, LAP_BEGAN, LAP_TIME, STUCK_STEPS, LEFT_AT = range(HIDDEN, HIDDEN + 6)
"""Rows that are kept for the rules; see ``rules.Referee``."""
_BEND, _HEADING, _AHEAD_X, _AHEAD_Y, _AHEAD_BEND = range(HIDDEN + 6, HIDDEN + 11)
"""Rows with the road: its curvature in the next step, its heading here, where it is at the look-ahead distance."""
STATE_SIZE: Final = HIDDEN + 11

_SUBSTEP: Final = 1.0 / 120.0  # s, at most
_AHEAD: Final = 16  # samples by which the tables go on beyond a lap

# In `floats`, first the car:
_MASS, _INERTIA, _FRONT, _REAR, _TREAD, _LOCK, _STEER_RATE, _FRONT_GRIP, _REAR_GRIP = range(9)
_FRONT_STIFF, _REAR_STIFF, _FRONT_WING, _REAR_WING, _HEIGHT, _RESERVE, _SKID, _FLOOR = range(9, 17)
_POWER, _THRUST, _TOP, _COASTING, _IDLING, _BRAKES, _BALANCE, _DRAG, _ROLLING = range(17, 26)
_STANDSTILL, _GAIN, _OFF_GRIP, _OFF_ROLLING, _VERGE, _WALL_LOSS = range(26, 32)
_SECONDS, _HALF_WIDTH, _LENGTH, _SPACING, _SPEED, _RISE, _RISE_STEPS, _BASE, _LOOK_GAIN = range(32, 41)
_SCALES: Final = 41  # mean and 1 / deviation of each observation
_TABLES: Final = _SCALES + 2 * len(OBSERVATIONS)
# In `ints`:
_PEDALS, _SUBSTEPS, _STUCK, _RANDOM, _PAYS, _SAMPLES, _SEEN, _SEEN_NAMES = range(8)
# Numbers of the observations:
_SEE_SPEED, _SEE_STEERING, _SEE_POSITION, _SEE_LOOKAHEAD, _SEE_ANGLE, _SEE_CURVATURE, _SEE_RAYS, _SEE_TARGET = range(8)

# Inlined by LLVM, not by Numba (inline="always"): as fast in the end, and compiled in a fifth of the time.
_inline = njit(forceinline=True, fastmath=FASTMATH, error_model="numpy")
# Without fastmath, observations are rounded alike wherever arrays are in memory: LLVM decides by their place whether a
# loop is SIMD, and the loop decides which products are fused with sums.
_exact = njit(forceinline=True, error_model="numpy")

# In the loops below, rows are parts of one flat array: only so can LLVM see that they do not overlap. For the same
# reason the tables of the road are read in loops of their own, which are not SIMD.


@_inline
def _drive(floats, ints, action, state, lanes):
    """One substep of the first lanes."""
    h = floats[_SECONDS] / ints[_SUBSTEPS]
    pedals = ints[_PEDALS] == 1
    lock, pace, half_width = floats[_LOCK], floats[_STEER_RATE], floats[_HALF_WIDTH]
    mass, a, b, off_grip = floats[_MASS], floats[_FRONT], floats[_REAR], floats[_OFF_GRIP]
    reserve, skid, floor = floats[_RESERVE], floats[_SKID], floats[_FLOOR]
    power, thrust, brakes, balance = floats[_POWER], floats[_THRUST], floats[_BRAKES], floats[_BALANCE]
    lightness, agility, fade = 1.0 / mass, 1.0 / floats[_INERTIA], 1.0 / floats[_STANDSTILL]
    spread, coasting, idling = 0.5 * floats[_TREAD] / (a + b), floats[_COASTING], 1.0 / floats[_IDLING]
    drag, weight = floats[_DRAG], floats[_MASS] * GRAVITY
    rolling, off_rolling = weight * floats[_ROLLING], weight * floats[_OFF_ROLLING]
    body = (a, b, lightness, agility, weight * b / (a + b), weight * a / (a + b))
    wings = (floats[_FRONT_WING], floats[_REAR_WING], floats[_HEIGHT] / (a + b))
    grip_f, grip_r, stiff = floats[_FRONT_GRIP], floats[_REAR_GRIP], (floats[_FRONT_STIFF], floats[_REAR_STIFF])
    limit, top = mass * floats[_GAIN], floats[_TOP]
    gain, hold = (0.0, 0.0) if pedals else (limit, drag)
    speed, rise, rise_steps = floats[_SPEED], floats[_RISE], floats[_RISE_STEPS]
    second = LANES if pedals else 0  # the row of the pedals; without them any will do
    for i in range(lanes):
        n, p, u = state[OFFSET * LANES + i], state[ANGLE * LANES + i], state[FORWARD * LANES + i]
        v, r, d = state[SIDEWAYS * LANES + i], state[TURNING * LANES + i], state[WHEELS * LANES + i]
        on_road = abs(n) <= half_width
        hold_on = 1.0 if on_road else off_grip
        resistance = rolling if on_road else off_rolling
        target = speed + rise * min(state[DRIVEN * LANES + i] / rise_steps, 1.0)
        pedal = within(action[second + i], 1.0)
        throttle = max(pedal, 0.0)
        push = pedal * (thrust if pedal > 0.0 else brakes) if pedals else rolling
        coast = (1.0 - throttle) * coasting if pedals else 0.0
        most = power * throttle if pedals else power
        tyres = (*body, *wings, hold_on * grip_f, hold_on * grip_r, *stiff, reserve, skid, floor)
        engine = (most, thrust, limit, top, coast, idling)
        motor = (*engine, brakes, balance, drag, resistance, fade, gain, target, push, hold)
        goal, bend = lock * within(action[i], 1.0), state[_BEND * LANES + i]
        ds, dn, dp, du, dv, dr, d = advance(h, n, p, u, v, r, d, goal, pace, spread, bend, tyres, motor)
        state[DISTANCE * LANES + i] += ds
        state[PROGRESS * LANES + i] += ds
        state[OFFSET * LANES + i], state[ANGLE * LANES + i] = n + dn, p + dp
        state[FORWARD * LANES + i], state[SIDEWAYS * LANES + i] = u + du, v + dv
        state[TURNING * LANES + i], state[WHEELS * LANES + i] = r + dr, d


@_inline
def _judge(floats, ints, state, reward, terminated, lanes):
    """After a step: walls, laps, rewards and ends."""
    half_width, length, seconds = floats[_HALF_WIDTH], floats[_LENGTH], floats[_SECONDS]
    along, centred = ints[_PAYS] >= 1, ints[_PAYS] == 2
    wall, loss, stuck_steps = half_width + floats[_VERGE], floats[_WALL_LOSS], np.float64(ints[_STUCK])
    for i in range(lanes):
        n, p = state[OFFSET * LANES + i], state[ANGLE * LANES + i]
        u, v, r = state[FORWARD * LANES + i], state[SIDEWAYS * LANES + i], state[TURNING * LANES + i]
        p -= 2.0 * math.pi * np.rint(p / (2.0 * math.pi))
        sin_p, cos_p = sincos(p)
        hits = (abs(n) > wall) & ((u * sin_p + v * cos_p) * n > 0.0)
        slide = (1.0 - loss) * (u * cos_p - v * sin_p)  # what is left of its motion is along the wall
        u, v, r = (slide * cos_p if hits else u), (-slide * sin_p if hits else v), (0.0 if hits else r)
        n = within(n, wall)
        s = state[DISTANCE * LANES + i]
        s -= length * np.floor(s / length)
        s = s if s < length else 0.0
        driven, laps = state[DRIVEN * LANES + i] + 1.0, state[LAPS * LANES + i]
        done = state[PROGRESS * LANES + i] >= (laps + 1.0) * length
        lap_time = (driven - state[LAP_BEGAN * LANES + i]) * seconds
        on_road = abs(n) <= half_width  # not so if it is not a number
        moves = on_road & (u >= STANDING / KMH)
        stuck_for = 0.0 if moves else state[STUCK_STEPS * LANES + i] + 1.0
        stuck = stuck_for >= stuck_steps
        pay = u * cos_p - v * sin_p if along else u
        pay *= 1.0 - (n / half_width) ** 2 if centred else 1.0
        reward[i] = STUCK_REWARD if stuck else (KMH * pay if on_road else OFF_ROAD_REWARD)
        terminated[i] = stuck
        state[DISTANCE * LANES + i], state[OFFSET * LANES + i], state[ANGLE * LANES + i] = s, n, p
        state[FORWARD * LANES + i], state[SIDEWAYS * LANES + i], state[TURNING * LANES + i] = u, v, r
        state[DRIVEN * LANES + i], state[LAPS * LANES + i] = driven, laps + 1.0 if done else laps
        state[LAP_TIME * LANES + i] = lap_time if done else state[LAP_TIME * LANES + i]
        state[LAP_BEGAN * LANES + i] = driven if done else state[LAP_BEGAN * LANES + i]
        state[STUCK_STEPS * LANES + i] = stuck_for
        state[LEFT_AT * LANES + i] = s if on_road else state[LEFT_AT * LANES + i]


@_inline
def _read(floats, table, where, spacing):
    """A quantity of the road at ``where`` metres, interpolated between its samples."""
    row = where / spacing
    i = np.int64(row)
    low = floats[table + i]
    return low + (row - i) * (floats[table + i + 1] - low)


@_inline
def _survey(floats, ints, state, i):
    """Looks up the road at the car of lane ``i`` and at the look-ahead distance."""
    spacing, length, seconds = floats[_SPACING], floats[_LENGTH], floats[_SECONDS]
    rows = ints[_SAMPLES] + _AHEAD + 1
    x, y, heading, bend = _TABLES, _TABLES + rows, _TABLES + 2 * rows, _TABLES + 3 * rows
    s, speed = state[DISTANCE * LANES + i], max(state[FORWARD * LANES + i], 0.0)
    if not 0.0 <= s < length:  # not a number
        s = 0.0
    ahead = floats[_BASE] + floats[_LOOK_GAIN] * speed
    there = s + ahead
    there -= length * np.floor(there / length)
    if not 0.0 <= there < length:
        there = 0.0
    stretch = min(max(speed, 1.0) * seconds, (_AHEAD - 1) * spacing)
    here = _read(floats, heading, s, spacing)
    state[_HEADING * LANES + i] = here
    state[_BEND * LANES + i] = (_read(floats, heading, s + stretch, spacing) - here) / stretch
    state[_AHEAD_X * LANES + i] = _read(floats, x, there, spacing) - _read(floats, x, s, spacing)
    state[_AHEAD_Y * LANES + i] = _read(floats, y, there, spacing) - _read(floats, y, s, spacing)
    state[_AHEAD_BEND * LANES + i] = _read(floats, bend, there, spacing)


@on_demand(fastmath=FASTMATH)
def survey(floats, ints, state):
    """Looks up the road at the car of lane 0 and at the look-ahead distance."""
    _survey(floats, ints, state.ravel(), 0)


@on_demand(fastmath=FASTMATH)
def reset(floats, ints, noise, lane, state):
    """Puts one lane on the start line, or anywhere on the road, in its middle and along it, at the first speed."""
    for row in range(STATE_SIZE):
        state[row, lane] = 0.0
    if ints[_RANDOM] == 1:
        state[DISTANCE, lane] = state[LEFT_AT, lane] = noise[0, lane] * floats[_LENGTH]
    state[FORWARD, lane] = floats[_SPEED]
    _survey(floats, ints, state.ravel(), lane)


@on_demand(fastmath=FASTMATH)
def step(floats, ints, noise, action, state, reward, terminated, lanes):
    """One step of the first lanes."""
    actions, flat = action.ravel(), state.ravel()
    for _ in range(ints[_SUBSTEPS]):
        _drive(floats, ints, actions, flat, lanes)
    _judge(floats, ints, flat, reward, terminated, lanes)
    for i in range(lanes):
        _survey(floats, ints, flat, i)


@_exact
def _bearing(state, i):
    """Bearing of the middle of the road at the look-ahead distance, from the car's heading (rad)."""
    n, p = state[OFFSET * LANES + i], state[ANGLE * LANES + i]
    x, y = state[_AHEAD_X * LANES + i], state[_AHEAD_Y * LANES + i]
    sin_p, cos_p = sincos(p)
    sin_h, cos_h = sincos(state[_HEADING * LANES + i] + p)
    return arctan2(y * cos_h - x * sin_h - n * cos_p, x * cos_h + y * sin_h - n * sin_p)


@_exact
def _look(floats, ints, state, seen, first, lanes):
    """The free road in all directions, written into ``seen`` from row ``first`` on."""
    rows = ints[_SAMPLES] + _AHEAD + 1
    for i in range(lanes):
        s = state[DISTANCE * LANES + i]
        n = state[OFFSET * LANES + i] if 0.0 <= s < floats[_LENGTH] else np.inf
        heading = state[_HEADING * LANES + i] + state[ANGLE * LANES + i]
        for ray in range(len(RAY_ANGLES)):
            seen[first + ray * LANES + i] = free_road(
                floats,
                _TABLES,
                rows,
                ints[_SAMPLES],
                floats[_SPACING],
                floats[_HALF_WIDTH],
                s,
                n,
                heading + RAY_ANGLES[ray],
            )


@_exact
def _see(floats, name, state, seen, first, lanes):
    """The observation with this number, in the first lanes, neither shifted nor scaled."""
    lock, half_width = floats[_LOCK], floats[_HALF_WIDTH]
    speed, rise, rise_steps = floats[_SPEED], floats[_RISE], floats[_RISE_STEPS]
    if name == _SEE_SPEED:
        for i in range(lanes):
            seen[first + i] = KMH * state[FORWARD * LANES + i]
    elif name == _SEE_STEERING:
        for i in range(lanes):
            seen[first + i] = state[WHEELS * LANES + i] / lock
    elif name == _SEE_POSITION:
        for i in range(lanes):
            seen[first + i] = state[OFFSET * LANES + i] / half_width
    elif name == _SEE_LOOKAHEAD:
        for i in range(lanes):
            seen[first + i] = _bearing(state, i)
    elif name == _SEE_ANGLE:
        for i in range(lanes):
            seen[first + i] = state[ANGLE * LANES + i]
    elif name == _SEE_CURVATURE:
        for i in range(lanes):
            seen[first + i] = state[_AHEAD_BEND * LANES + i]
    else:
        for i in range(lanes):
            seen[first + i] = KMH * (speed + rise * min(state[DRIVEN * LANES + i] / rise_steps, 1.0))


@on_demand()
def observe(floats, ints, state, observation, lanes):
    """Writes the observations of the first lanes, shifted and scaled."""
    rows, seen = state.ravel(), observation.ravel()
    first = 0
    for k in range(ints[_SEEN]):
        name = ints[_SEEN_NAMES + k]
        size = len(RAY_ANGLES) if name == _SEE_RAYS else 1
        if name == _SEE_RAYS:
            _look(floats, ints, rows, seen, first, lanes)
        else:
            _see(floats, name, rows, seen, first, lanes)
        mean, scale = floats[_SCALES + 2 * name], floats[_SCALES + 2 * name + 1]
        for row in range(first, first + size * LANES, LANES):
            for i in range(row, row + lanes):
                seen[i] = scale * (seen[i] - mean)
        first += size * LANES


def pack(shape: Shape, width: float, car: Car, rules: Rules) -> EnvKernel:
    """The kernel of a drive.

    Args:
        shape: Middle line of the road.
        width: Width of the road (m).
        car: The car.
        rules: The rules.
    """
    profile, rows = rules.profile, len(shape.x) + _AHEAD + 1
    start, end, seconds = (PEDALS_START, PEDALS_START, 1.0) if profile is None else astuple(profile)
    drive = [1.0 / rules.control_hz, 0.5 * width, shape.length, shape.spacing]
    drive += [start / KMH, (end - start) / KMH, seconds * rules.control_hz, *rules.lookahead]
    scales = [number for scale in OBSERVATIONS.values() for number in (scale.mean, 1.0 / scale.deviation)]
    around = np.arange(rows) % len(shape.x)
    heading = shape.heading[around] + shape.turning * (np.arange(rows) // len(shape.x))
    tables = [shape.x[around], shape.y[around], heading, shape.curvature[around], np.cos(heading), np.sin(heading)]
    names = [list(OBSERVATIONS).index(name) for name in rules.observations]
    numbers = [rules.profile is None, max(1, math.ceil(drive[0] / _SUBSTEP - 1e-9)), rules.stuck_steps]
    numbers += [rules.start == "random", REWARDS.index(rules.reward), len(shape.x), len(names), *names]
    return EnvKernel(
        reset=reset,
        observe=observe,
        step=step,
        floats=np.concatenate([astuple(car), drive, scales, *tables]),
        ints=np.array(numbers, np.int64),
        state_size=STATE_SIZE,
        observation_size=sum(OBSERVATIONS[name].size for name in rules.observations),
        action_size=2 if profile is None else 1,
        draws=1 if rules.start == "random" else 0,
    )


def state_at(kernel: EnvKernel, rules: Rules, driven_steps: int, distance: float) -> NDArray[np.float64]:
    """The state of a car in the middle of the road and along it, at the speed of the profile.

    Args:
        kernel: A kernel that ``pack`` made.
        rules: The rules.
        driven_steps: Number of steps driven before.
        distance: Distance along the middle line (m).

    Returns:
        The rows of the kernel's state, ``(STATE_SIZE,)``.
    """
    state = np.zeros((STATE_SIZE, LANES))
    state[DISTANCE, 0] = state[LEFT_AT, 0] = distance % kernel.floats[_LENGTH]
    state[DRIVEN, 0] = state[LAP_BEGAN, 0] = driven_steps
    state[FORWARD, 0] = rules.target_speed(driven_steps) / KMH
    survey(kernel.floats, kernel.ints, state)
    column: NDArray[np.float64] = state[:, 0].copy()
    return column
