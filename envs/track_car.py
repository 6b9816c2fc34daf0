"""The car that drives on the embedded track: every number of its model, in one table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

GRAVITY: Final = 9.81  # m/s^2


@dataclass(frozen=True, kw_only=True)
class Car:
    """A racing car with rear-wheel drive, like the Porsche GT1 of TORCS.

    Of that car are mass, lock and the pace of the steering; the rest are usual numbers of such cars, to be replaced by
    measured ones. At low speed only wheelbase and lock decide where it goes.

    Attributes:
        mass: kg.
        yaw_inertia: About the vertical axis (kg m^2).
        front: From the centre of mass to the front axle (m).
        rear: From the centre of mass to the rear axle (m).
        lock: Largest angle of the front wheels (rad).
        steer_rate: How fast they turn (rad/s).
        grip: Largest force of a tyre on the road, as a share of its load.
        front_stiffness: Side force of the front tyres for a small slip angle (1/rad), as a share of their load.
        rear_stiffness: The same of the rear tyres; more than in front, so that the car understeers.
        reserve: Share of a tyre's grip that drive or brakes can take; what is left for the sides is never nothing.
        slip_floor: Slip angles are reckoned with at least this speed of the wheel (m/s), for below it tyres would
            become ever stiffer. The wheels still roll where they point, to a percent.
        power: Of the engine (W).
        thrust: Largest force of the engine, in the lowest gear (N).
        brakes: Largest force of all brakes together (N).
        brake_balance: Share of the front brakes.
        drag: Of the air, force over speed squared (N s^2/m^2).
        rolling: Resistance of the wheels on the road, as a share of the weight.
        standstill: Speed (m/s) below which brakes and resistance fade out, so that they stop the car and no more.
        speed_gain: Acceleration that the speed controller demands for each m/s that is missing (1/s).
        off_road_grip: Share of the grip that there is beside the road.
        off_road_rolling: Resistance of the wheels there, as a share of the weight.
        verge: Width of what is beside the road, up to a wall (m).
        wall_loss: Share of its speed along the wall that the car loses in a step that touches it.
    """

    mass: float = 950.0
    yaw_inertia: float = 1450.0
    front: float = 1.35
    rear: float = 1.15
    lock: float = math.radians(45.0)
    steer_rate: float = math.radians(120.0)
    grip: float = 1.6
    front_stiffness: float = 24.0
    rear_stiffness: float = 28.0
    reserve: float = 0.95
    slip_floor: float = 3.0
    power: float = 440e3
    thrust: float = 9000.0
    brakes: float = 14000.0
    brake_balance: float = 0.5
    drag: float = 0.6
    rolling: float = 0.015
    standstill: float = 0.3
    speed_gain: float = 2.0
    off_road_grip: float = 0.6
    off_road_rolling: float = 0.12
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
