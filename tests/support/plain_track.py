"""The car once more, in plain Python on flat ground, from the forces on its wheels; and a driver with simple habits."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dpsearch.envs import Track
from dpsearch.envs.driving.car import Car
from dpsearch.envs.driving.rules import KMH, OBSERVATIONS

Array = NDArray[np.float64]


@dataclass
class PlainCar:
    """A car on an endless plain; its state is x, y, yaw, and velocities to the east and north and of the yaw."""

    car: Car
    off_road: bool = False

    def tyre(self, velocity: complex, load: float, grip: float, stiffness: float, along: float) -> complex:
        """Force on a wheel, in its own frame, which moves with this velocity in that frame."""
        room = math.sqrt((grip * load) ** 2 - along**2)
        slip = abs(velocity.imag) / max(abs(velocity.real), self.car.slip_floor)
        full = 3.0 * room / (stiffness * load)  # the slip from which the whole contact patch slides
        side = room if slip >= full else room * (3 * (slip / full) - 3 * (slip / full) ** 2 + (slip / full) ** 3)
        return complex(along, -math.copysign(side, velocity.imag))

    def derivative(self, state: Array, wheels: float, demand: float | None, target: float) -> Array:
        """Time derivative of the state, by Newton's laws in the ground's frame."""
        car, weight = self.car, self.car.mass * 9.81
        coasting = 0.0
        yaw, velocity, rate = state[2], complex(state[3], state[4]), state[5]
        ahead = complex(math.cos(yaw), math.sin(yaw))
        u = (velocity / ahead).real
        power = car.power
        if demand is None:
            force = car.mass * car.speed_gain * (target - u) + car.drag * u * abs(u)
            force += car.rolling * weight
        else:
            throttle = max(demand, 0.0)
            force, power = demand * (car.thrust if demand > 0 else car.brakes), car.power * throttle
            coasting = (1.0 - throttle) * car.coasting * min(max(u / car.idling, -1.0), 1.0)
        engine = max(min(force, car.thrust, power / max(u, 1.0), car.mass * car.speed_gain * (car.top_speed - u)), 0.0)
        engine -= coasting
        brake = min(max(-force, 0.0), car.brakes)
        fading = min(max(u / car.standstill, -1.0), 1.0)
        front_brake = car.brake_balance * brake
        rear_brake = fading * (brake - front_brake)
        total, moment = complex(0.0, 0.0), 0.0
        length, surface = car.front + car.rear, car.off_road_grip if self.off_road else 1.0
        middle = math.atan(math.tan(wheels) / (1.0 + 0.5 * car.tread / length * abs(math.tan(wheels))))
        axles = (
            (car.front, car.front_load, car.front_wing, car.front_grip, car.front_stiffness, middle),
            (-car.rear, car.rear_load, car.rear_wing, car.rear_grip, car.rear_stiffness, 0.0),
        )
        along_axles = (-fading * front_brake, engine - rear_brake)
        most = sum(surface * best * (standing + wing * u * u) for _, standing, wing, best, _, _ in axles)
        shift = car.height / length * min(max(engine - fading * brake, -most), most)
        for (arm, standing, wing, best, stiffness, turned), along in zip(axles, along_axles, strict=True):
            grip, load = surface * best, standing + wing * u * u - math.copysign(1.0, arm) * shift
            wheel = ahead * complex(math.cos(turned), math.sin(turned))
            moving = velocity + 1j * rate * arm * ahead
            limited = min(max(along, -car.skid * grip * load), car.reserve * grip * load)
            force_on = wheel * self.tyre(moving / wheel, load, grip, stiffness, limited)
            total += force_on
            moment += arm * (force_on / ahead).imag
        rolling = car.off_road_rolling if self.off_road else car.rolling
        total -= ahead * (car.drag * u * abs(u) + rolling * weight * fading)
        acceleration = total / car.mass
        return np.array([state[3], state[4], rate, acceleration.real, acceleration.imag, moment / car.yaw_inertia])

    def drive(
        self, state: Array, wheels: float, steer: float, seconds: float, demand: float | None, target: float
    ) -> tuple[Array, float]:
        """The exact state, and where the wheels point, after some time with the steering held at ``steer``."""
        goal = steer * self.car.lock
        turning = abs(goal - wheels) / self.car.steer_rate
        ends, turn = [0.0, min(turning, seconds), seconds], math.copysign(self.car.steer_rate, goal - wheels)
        for (begin, end), pace in zip(itertools.pairwise(ends), (turn, 0.0), strict=True):
            if end > begin:

                def rates(t: float, y: Array, at: float = wheels, pace: float = pace, t0: float = begin) -> Array:
                    return self.derivative(y, at + pace * (t - t0), demand, target)

                state = solve_ivp(rates, (begin, end), state, method="DOP853", rtol=1e-10, atol=1e-11).y[:, -1]
                wheels += pace * (end - begin)
        return state, goal if seconds >= turning else wheels


def steer_ahead(observation: NDArray[Any], names: tuple[str, ...], car: Car) -> Any:
    """Steering that would lead to the look-ahead point on an arc, as a fraction of the lock, for one car or many."""
    seen = {}
    for name in ("speed", "lookahead"):
        seen[name] = observation[..., names.index(name)] * OBSERVATIONS[name].deviation + OBSERVATIONS[name].mean
    distance = 10.0 + seen["speed"] / KMH
    arc = np.arctan(2.0 * car.wheelbase * np.sin(seen["lookahead"]) / distance)
    return arc / car.lock


def ground(env: Track) -> tuple[Array, float]:
    """The state of ``PlainCar``, and the angle of the wheels, of a car on a track."""
    s, n, p, u, v, r, wheels, _ = env.task.hidden(env.kernel_state()[None])[0].tolist()
    x, y, heading = env.task.shape.at(s, n)
    yaw = heading + p
    velocity = complex(u, v) * complex(math.cos(yaw), math.sin(yaw))
    return np.array([x, y, yaw, velocity.real, velocity.imag, r]), wheels
