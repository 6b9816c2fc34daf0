"""The car that drives on the embedded track: every number of its model, in one table.

It is fitted to the car ``gt1`` of the real TORCS (``torcs/gt1.xml``) on a flat plane of the asphalt of e-track-1,
friction 1.2, at up to 240 km/h. Mass, axles, lock and pace of the steering are those of its file. The others are the
least squares of paths, headings and velocities after steps of the steering, of a pedal, and of both together; what
holds off the road is fitted to a plane of its grass, friction 0.4. ``tests/support/torcs_recording.txt`` has part of
the recordings, and ``tests/envs/driving/test_calibration.py`` holds the car to them.

Error after 2 s of steering, against TORCS: as a share of the way, and in degrees of so many that the heading turned::

    steering  20 km/h           60 km/h           120 km/h          180 km/h          220 km/h
       0.01                                       0.3%  -0.2 of 11  0.3%  -0.2 of 14  0.2%  -0.1 of 16
       0.02   0.3%  -0.1 of  4  0.4%  -0.4 of 12  0.7%  -0.6 of 22  0.5%  -0.5 of 27  0.4%  -0.2 of 29
       0.05   0.4%  -0.4 of 10  0.8%  -0.8 of 29  1.4%  -1.4 of 50  1.4%   2.3 of 49  1.8%   2.9 of 48
       0.1    0.4%  -0.6 of 20  1.4%  -1.3 of 57  0.4%   0.9 of 69  1.6%   2.3 of 57  1.3%   2.2 of 54
       0.2    0.3%  -0.8 of 38  0.5%   1.3 of 100 1.8%  -2.0 of 72  0.1%   0.2 of 58  0.1%   0.2 of 56
       0.4    1.2%   1.0 of 70  2.7%  -2.9 of 115 2.5%  -2.7 of 70

The front tyres slide at 17 m/s^2 at 60 km/h, 20 at 120 and 29 at 220, where the wings press the car down. Full
throttle takes it from 10 to 100 km/h in 2.5 s (TORCS: 2.4 s), to 200 in 6.4 s (6.5 s), and at last to 268 km/h (269).
Full brakes stop it from 60 km/h within 7.8 m (8.5 m), from 100 within 20.4 m (21.8 m), from 240 within 100 m (97 m).
With the pedals, speeds are off by less than a tenth of the fastest of the same recording. With 0.05 of the steering and
half of the brakes both cars spin: from 160 km/h they have turned by 79 degrees (67) after 1.4 s, but with half the
throttle by 35 (34). With all of the brakes the wheels lock, and both go straight on, within 5 degrees. Other headings
with a pedal are within 4 degrees, or a fifth. On grass paths are within 6%, headings within 15%.

What does not fit: a gearbox makes what the engine does depend on the gear. With full throttle in a curve, TORCS' car
skids at 80 km/h, this one less. And roads are flat here, while those of TORCS have hills and banks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

GRAVITY: Final = 9.81  # m/s^2


@dataclass(frozen=True, kw_only=True)
class Car:
    """A racing car with rear-wheel drive, like the Porsche GT1 of TORCS.

    Attributes:
        mass: Mass with 5 l of fuel (kg).
        yaw_inertia: Moment of inertia about the vertical axis (kg m^2).
        front: Distance from the centre of mass to the front axle (m).
        rear: Distance from the centre of mass to the rear axle (m).
        tread: Distance between the front wheels (m); the inner one is turned further than the outer one.
        lock: Largest angle of the inner front wheel (rad).
        steer_rate: Speed at which the inner front wheel turns (rad/s).
        front_grip: Largest force of the front tyres on the road, as a share of their load.
        rear_grip: Largest force of the rear tyres, as a share of their load; more than in front, so that the front
            slides first.
        front_stiffness: Side force of the front tyres for a small slip angle (1/rad), as a share of their load.
        rear_stiffness: Side force of the rear tyres for a small slip angle (1/rad), as a share of their load.
        front_wing: Downforce on the front axle over speed squared (N s^2/m^2).
        rear_wing: Downforce on the rear axle over speed squared (N s^2/m^2).
        height: Height of the centre of mass (m), by which brakes and engine shift load from axle to axle.
        reserve: Share of a tyre's grip that drive can take; what is left for the sides is never nothing.
        skid: Share of a tyre's grip that brakes can take: then the wheels are locked.
        slip_floor: Slip angles are reckoned with at least this speed of the wheel (m/s), for below it tyres would
            become ever stiffer. The wheels still roll where they point, to a percent.
        power: Power of the engine (W).
        thrust: Largest force of the engine, in the lowest gear (N).
        top_speed: Speed at which the engine is at its limit in the highest gear used, and gives no more force (m/s).
        coasting: Force with which the engine brakes without throttle (N).
        idling: Speed (m/s) from which the engine brakes with all of that force; below, the slower the car, the less.
        brakes: Largest force of all brakes together (N), without the engine.
        brake_balance: Share of the front brakes.
        drag: Drag of the air, wings and wheels over speed squared (N s^2/m^2).
        rolling: Resistance of the wheels on the road, as a share of the weight.
        standstill: Speed (m/s) below which brakes and resistance fade out, so that they stop the car and no more.
        speed_gain: Acceleration that the speed controller demands for each m/s that is missing (1/s). With the same
            slope, for want of a better one, the engine's force fades in the last half m/s before ``top_speed``.
        off_road_grip: Grip beside the road, as a share of the grip on it.
        off_road_rolling: Resistance of the wheels beside the road, as a share of the weight.
        verge: Width of the strip beside the road, up to a wall (m); the grass of e-track-1 is mostly as wide.
        wall_loss: Share of its speed along the wall that the car loses in a step that touches it; not measured.
    """

    mass: float = 953.75
    yaw_inertia: float = 790.0
    front: float = 1.35
    rear: float = 1.15
    tread: float = 1.57
    lock: float = math.radians(45.0)
    steer_rate: float = math.radians(120.0)
    front_grip: float = 1.75
    rear_grip: float = 1.845
    front_stiffness: float = 44.9
    rear_stiffness: float = 48.0
    front_wing: float = 0.9
    rear_wing: float = 1.275
    height: float = 0.196
    reserve: float = 0.823
    skid: float = 0.997
    slip_floor: float = 6.0
    power: float = 321.0e3
    thrust: float = 14_340.0
    top_speed: float = 74.6
    coasting: float = 2210.0
    idling: float = 17.3
    brakes: float = 19_170.0
    brake_balance: float = 0.73
    drag: float = 0.366
    rolling: float = 0.02
    standstill: float = 0.3
    speed_gain: float = 8.0
    off_road_grip: float = 0.282
    off_road_rolling: float = 0.03
    verge: float = 8.0
    wall_loss: float = 0.1

    @property
    def wheelbase(self) -> float:
        """Distance between the axles (m)."""
        return self.front + self.rear

    @property
    def front_load(self) -> float:
        """Weight on the front axle (N)."""
        return self.mass * GRAVITY * self.rear / self.wheelbase

    @property
    def rear_load(self) -> float:
        """Weight on the rear axle (N)."""
        return self.mass * GRAVITY * self.front / self.wheelbase
