"""The car that drives on the embedded track: every number of its model, in one table.

It is fitted to the car ``gt1`` of the real TORCS (``torcs/gt1.xml``) on a flat plane of the asphalt of e-track-1,
friction 1.2. Mass, axles, lock and pace of the steering are those of its file; grip, stiffness, inertia and tread are
the least squares of paths, headings and velocities after steps of the steering; brakes, engine and drag those of speeds
after steps of the pedals; what holds off the road is fitted to a plane of its grass, friction 0.4.
``tests/envs/torcs_recording.txt`` has part of the recordings, and ``test_track_calibration.py`` holds the car to them.

How far it misses TORCS after 2 s of steering, as a share of the way, and in degrees of the heading of so many::

    steering   20 km/h             40 km/h             60 km/h              80 km/h             120 km/h
       0.02    0.3%  -0.1 of  4    0.1%  -0.1 of  8    0.3%  -0.3 of  12    0.2%  -0.1 of 15    0.1%   0.2 of 22
       0.05    0.4%  -0.4 of 10    0.2%  -0.3 of 20    0.6%  -0.7 of  29    0.7%  -0.6 of 38    0.4%   0.7 of 50
       0.1     0.5%  -0.8 of 20    0.5%  -0.6 of 38    1.1%  -1.2 of  57    1.2%  -1.2 of 72    1.9%  -1.3 of 69
       0.2     0.7%  -1.2 of 38    1.0%  -1.3 of 74    2.2%   3.1 of 100    1.5%   2.5 of 95    4.5%  -4.7 of 72
       0.4     1.0%  -0.6 of 70    1.8%   2.2 of 131   5.3%   8.6 of 116    0.5%   1.7 of 94    4.3%  -4.0 of 70

From 0.2 of the lock at 80 km/h on, the front tyres slide, at 19.4 m/s^2 (TORCS: 18.7; 17 at 60 km/h, 21 at 120, where
its wings press it down). Full throttle takes the car from 10 to 100 km/h in 2.3 s (2.4 s), to 200 in 6.5 s (6.5 s), and
at last to 269 km/h (269). Full brakes stop it from 60 km/h within 8.3 m (8.5 m), from 100 within 22.6 m (21.7 m). On
grass its path is within 5%, its heading within 12%.

What does not fit:

- With the wheels turned fully, TORCS' tyres scrub more: 13.4 m/s^2 at 60 km/h, here 15.9.
- A gearbox makes what the engine does without throttle, or with little, depend on the gear. After 3 s of rolling, 100
  km/h are 82 (82), 40 are 27 (25), but 60 are 46 (33) and 20 are 8 (16). With a throttle of 0.2, TORCS' car settles at
  65 to 90 km/h; this one goes on to gain speed.
- There are no wings: from 150 km/h it takes 50 m to stop (44 m), and from 200 to 250 km/h 6.6 s (3.7 s).
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
        mass: With 5 l of fuel (kg).
        yaw_inertia: About the vertical axis (kg m^2).
        front: From the centre of mass to the front axle (m).
        rear: From the centre of mass to the rear axle (m).
        tread: Between the front wheels (m), of which the inner one is turned further than the outer one.
        lock: Largest angle of the inner front wheel (rad).
        steer_rate: How fast it turns (rad/s).
        front_grip: Largest force of the front tyres on the road, as a share of their load.
        rear_grip: The same of the rear tyres; more than in front, so that the car slides with the front first.
        front_stiffness: Side force of the front tyres for a small slip angle (1/rad), as a share of their load.
        rear_stiffness: The same of the rear tyres.
        reserve: Share of a tyre's grip that drive can take; what is left for the sides is never nothing.
        skid: Share of it that brakes can take: then the wheels are locked.
        slip_floor: Slip angles are reckoned with at least this speed of the wheel (m/s), for below it tyres would
            become ever stiffer. The wheels still roll where they point, to a percent.
        power: Of the engine (W).
        thrust: Largest force of the engine, in the lowest gear (N).
        coasting: With what force the engine brakes if there is no throttle (N).
        brakes: Largest force of all brakes together (N).
        brake_balance: Share of the front brakes.
        drag: Of the air, wings and wheels, force over speed squared (N s^2/m^2).
        rolling: Resistance of the wheels on the road, as a share of the weight.
        standstill: Speed (m/s) below which brakes and resistance fade out, so that they stop the car and no more.
        speed_gain: Acceleration that the speed controller demands for each m/s that is missing (1/s).
        off_road_grip: Share of the grip that there is beside the road.
        off_road_rolling: Resistance of the wheels there, as a share of the weight.
        verge: Width of what is beside the road, up to a wall (m); the grass of e-track-1 is mostly as wide.
        wall_loss: Share of its speed along the wall that the car loses in a step that touches it; not measured.
    """

    mass: float = 953.75
    yaw_inertia: float = 1255.0
    front: float = 1.35
    rear: float = 1.15
    tread: float = 2.0
    lock: float = math.radians(45.0)
    steer_rate: float = math.radians(120.0)
    front_grip: float = 1.995
    rear_grip: float = 2.207
    front_stiffness: float = 60.3
    rear_stiffness: float = 64.1
    reserve: float = 0.95
    skid: float = 0.934
    slip_floor: float = 6.0
    power: float = 353.6e3
    thrust: float = 13_170.0
    coasting: float = 906.0
    brakes: float = 22_100.0
    brake_balance: float = 0.65
    drag: float = 0.8145
    rolling: float = 0.02
    standstill: float = 0.3
    speed_gain: float = 8.0
    off_road_grip: float = 0.275
    off_road_rolling: float = 0.03
    verge: float = 8.0
    wall_loss: float = 0.1

    @property
    def wheelbase(self) -> float:
        """Between the axles (m)."""
        return self.front + self.rear

    @property
    def front_load(self) -> float:
        """Weight on the front axle (N)."""
        return self.mass * GRAVITY * self.rear / self.wheelbase

    @property
    def rear_load(self) -> float:
        """Weight on the rear axle (N)."""
        return self.mass * GRAVITY * self.front / self.wheelbase
