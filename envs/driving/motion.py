"""The motion of a car on a road, compiled to be called in loops over lanes.

A bicycle, as it is called: both wheels of an axle are one. The body has the velocity u forwards and v to the left and
turns at the rate r; the front wheels, a metres ahead of the centre of mass, point to the left by the angle d, the rear
wheels are b metres behind it. Steered is the inner one of the two front wheels; with the tread t, the one in the middle
has cot d = cot(inner) + t / 2 (a + b), as the Ackermann steering of TORCS::

    m (du/dt - v r) = X_f cos d - Y_f sin d + X_r - drag u |u| - rolling resistance
    m (dv/dt + u r) = X_f sin d + Y_f cos d + Y_r
    I dr/dt         = a (X_f sin d + Y_f cos d) - b Y_r

X are forces along the wheels, of the engine (rear) and the brakes, Y those to their sides. The load of an axle is its
part of the weight, what the wings press on it, wing u^2, and what brakes (in front) or engine (behind) shift to it,
h / (a + b) of what they are asked for and the tyres can hold, where h is the height of the centre of mass. Grip and
stiffness grow with the load, so that who brakes a little in a curve spins. Of the grip G = mu * load of an axle, X
leaves sqrt(G^2 - X^2) to the sides (the friction circle), of which the slip s, speed sideways over speed forwards,
takes the share of Fiala's brush, which grows from a stiffness to full sliding::

    Y = -sign(s) (1 - (1 - z)^3) sqrt(G^2 - X^2),  z = min(1, stiffness |s| / (3 sqrt(G^2 - X^2)))

The car's place is that of its centre of mass along the middle line (s), to the left of it (n), and the angle between
the car and the line (p), so the nearest point of the road need never be looked for; k is the line's curvature::

    ds/dt = (u cos p - v sin p) / (1 - n k),  dn/dt = u sin p + v cos p,  dp/dt = r - k ds/dt

Within a step, k is the mean over the stretch that the car will cover at its present speed, so that headings add up.
Fourth-order Runge and Kutta integrates.

Source: E. Fiala, "Seitenkräfte am rollenden Luftreifen", VDI-Zeitschrift 96, 1954; R. Rajamani, "Vehicle Dynamics and
Control", 2nd edition, 2012, chapters 2 (bicycle, path coordinates) and 13 (brush).
"""

from __future__ import annotations

import math
from typing import Final

from numba import njit

from dpsearch.kernels.elementary import sincos
from dpsearch.kernels.lanes import FASTMATH

_NEAR: Final = 0.1  # the smallest 1 - n k: walls keep the car from places where it would be less

# Inlined by LLVM, not by Numba (inline="always"): as fast in the end, and compiled in a fifth of the time.
_inline = njit(forceinline=True, fastmath=FASTMATH, error_model="numpy")


@_inline
def within(x, bound):
    """The number in [-bound, bound] that is nearest to x."""
    return min(max(x, -bound), bound)


@_inline
def _side_force(sideways, forwards, stiffness, grip, along, floor):
    """Fiala's brush: force to the left on an axle, for the motion of its wheels and the force along them."""
    room = math.sqrt(grip * grip - along * along)
    rest = 1.0 - min(stiffness * abs(sideways) / (3.0 * room * max(abs(forwards), floor)), 1.0)
    force = room * (1.0 - rest * rest * rest)
    return -force if sideways > 0.0 else force


@_inline
def _rates(n, p, u, v, r, sin_d, cos_d, bend, tyres, motor):
    """Time derivatives of (s, n, p, u, v, r); ``tyres`` and ``motor`` are constant in a substep.

    Mass, inertia and the speed of the standstill are given as inverses, for divisions take long.
    """
    a, b, lightness, agility, load_f, load_r, wing_f, wing_r, lever = tyres[:9]
    mu_f, mu_r, stiff_f, stiff_r, reserve, skid, floor = tyres[9:]
    power, thrust, limit, top, coast, idling, brakes, balance, drag, rolling, fade, gain, target, push, hold = motor
    demand = gain * (target - u) + push + hold * u * abs(u)
    engine = max(min(min(min(demand, thrust), power / max(u, 1.0)), limit * (top - u)), 0.0)
    engine -= coast * within(u * idling, 1.0)
    fading = within(u * fade, 1.0)
    brake = fading * min(max(-demand, 0.0), brakes)
    load_f, load_r = load_f + wing_f * u * u, load_r + wing_r * u * u
    shift = lever * within(engine - brake, load_f * mu_f + load_r * mu_r)
    load_f, load_r = load_f - shift, load_r + shift
    grip_f, grip_r, stiff_f, stiff_r = load_f * mu_f, load_r * mu_r, load_f * stiff_f, load_r * stiff_r
    x_f = -within(balance * brake, skid * grip_f)
    x_r = min(max(engine - (1.0 - balance) * brake, -skid * grip_r), reserve * grip_r)
    left_f = v + a * r
    y_f = _side_force(left_f * cos_d - u * sin_d, u * cos_d + left_f * sin_d, stiff_f, grip_f, x_f, floor)
    y_r = _side_force(v - b * r, u, stiff_r, grip_r, x_r, floor)
    front = x_f * sin_d + y_f * cos_d
    du = (x_f * cos_d - y_f * sin_d + x_r - drag * u * abs(u) - rolling * fading) * lightness + v * r
    dv = (front + y_r) * lightness - u * r
    dr = (a * front - b * y_r) * agility
    sin_p, cos_p = sincos(p)
    ds = (u * cos_p - v * sin_p) / max(1.0 - n * bend, _NEAR)
    return ds, u * sin_p + v * cos_p, r - bend * ds, du, dv, dr


@_inline
def _mean(h, k1, k2, k3, k4):
    return h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


@_inline
def _both_wheels(inner, spread):
    """Sine and cosine of the angle of the model's one front wheel, from the angle of the inner one of two."""
    sin, cos = sincos(inner)
    cos += spread * abs(sin)
    norm = 1.0 / math.sqrt(sin * sin + cos * cos)
    return norm * sin, norm * cos


@_inline
def advance(h, n, p, u, v, r, d, goal, pace, spread, bend, tyres, motor):
    """One substep of h seconds: the changes of (s, n, p, u, v, r), and the angle of the inner wheel afterwards."""
    sin_1, cos_1 = _both_wheels(d, spread)
    d += within(goal - d, h * pace)
    sin_4, cos_4 = _both_wheels(d, spread)
    sin_2, cos_2 = 0.5 * (sin_1 + sin_4), 0.5 * (cos_1 + cos_4)  # in a substep the wheels turn by a degree at most
    s1, n1, p1, u1, v1, r1 = _rates(n, p, u, v, r, sin_1, cos_1, bend, tyres, motor)
    g = 0.5 * h
    s2, n2, p2, u2, v2, r2 = _rates(
        n + g * n1, p + g * p1, u + g * u1, v + g * v1, r + g * r1, sin_2, cos_2, bend, tyres, motor
    )
    s3, n3, p3, u3, v3, r3 = _rates(
        n + g * n2, p + g * p2, u + g * u2, v + g * v2, r + g * r2, sin_2, cos_2, bend, tyres, motor
    )
    s4, n4, p4, u4, v4, r4 = _rates(
        n + h * n3, p + h * p3, u + h * u3, v + h * v3, r + h * r3, sin_4, cos_4, bend, tyres, motor
    )
    return (
        _mean(h, s1, s2, s3, s4),
        _mean(h, n1, n2, n3, n4),
        _mean(h, p1, p2, p3, p4),
        _mean(h, u1, u2, u3, u4),
        _mean(h, v1, v2, v3, v4),
        _mean(h, r1, r2, r3, r4),
        d,
    )
