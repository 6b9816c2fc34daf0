"""The car's motion: against a plain simulation on open ground, closed forms, and what every driver knows."""

from __future__ import annotations

import itertools
import math
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dpsearch.env_kit.stepper import LaneStepper
from dpsearch.envs import Track
from dpsearch.envs.driving import kernel as rows
from dpsearch.envs.driving.car import GRAVITY, Car
from dpsearch.envs.driving.rules import KMH
from dpsearch.envs.driving.track import track_task
from tests.support.plain_track import Array, PlainCar, ground, steer_ahead

CAR = Car()


def placed(env: Track, **state: float) -> None:
    """Puts the car of an environment, which was just reset, into another state."""
    full = env.kernel_state()
    for name, value in state.items():
        full[getattr(rows, name)] = value
    env._stepper.put(0, full)


def steady(env: Track, steer: float, seconds: float) -> tuple[float, float, float]:
    """Velocities u, v and r after holding the wheel for some time."""
    for _ in range(round(seconds * env.task.rules.control_hz)):
        env.step(np.array([steer]))
    u, v, r = env.kernel_state()[[rows.FORWARD, rows.SIDEWAYS, rows.TURNING]].tolist()
    return u, v, r


def middle(inner: float) -> float:
    """Where the one front wheel of the model points, if the inner one of two points there (rad)."""
    return math.copysign(math.atan(1 / (1 / math.tan(abs(inner)) + 0.5 * CAR.tread / CAR.wheelbase)), inner)


@pytest.mark.parametrize("pedals", [False, True])
@pytest.mark.parametrize("off_road", [False, True])
def test_a_step_is_close_to_the_exact_motion(pedals: bool, off_road: bool) -> None:
    """From states as wild as can be: up to full slides, with the wheels turned from one side to the other."""
    env = Track(track="oval", width=30.0, speed_profile=None if pedals else 60)
    plain = PlainCar(CAR, off_road)
    errors, backwards = measured(env, plain, pedals)
    assert (np.max(errors[~backwards], axis=0) < [3e-5, 3e-5, 3e-5, 2e-3, 2e-3, 2e-3]).all()
    # Brakes that stop a car which rolls back let go within a part of one substep, and the loads on the axles with them.
    assert (np.max(errors[backwards], axis=0) < [3e-3, 3e-3, 3e-3, 0.15, 0.15, 0.15]).all()
    assert (np.median(errors, axis=0) < [1e-6, 1e-6, 1e-6, 1e-4, 1e-4, 1e-4]).all()


@pytest.mark.parametrize("pedals", [False, True])
def test_every_number_of_another_car_counts(pedals: bool) -> None:
    random = np.random.default_rng(4)
    numbers = asdict(CAR)
    largest = {"reserve": 1.0, "skid": 1.0}  # of the grip, both at most all of it
    other = Car(**{name: value * random.uniform(0.8, largest.get(name, 1.2)) for name, value in numbers.items()})
    for off_road in (False, True):
        env = Track(track="oval", width=30.0, speed_profile=None if pedals else 60)
        env.task = track_task("oval", 30.0, env.task.rules, 1000, other)
        env._stepper = LaneStepper(env.task.kernel, 1)
        errors, _ = measured(env, PlainCar(other, off_road), pedals)
        assert (np.median(errors, axis=0) < [1e-6, 1e-6, 1e-6, 2e-4, 2e-4, 2e-4]).all()  # stiffer tyres than ours


def measured(env: Track, plain: PlainCar, pedals: bool) -> tuple[Array, NDArray[np.bool_]]:
    """By how much a step of the environment misses the exact motion, from random states, and which roll backwards."""
    random = np.random.default_rng(1)
    errors, backwards = [], []
    for _ in range(40):
        env.reset(seed=0, options={"distance": float(random.uniform(20, 400))})
        velocities = {"FORWARD": random.uniform(-2, 30), "SIDEWAYS": random.normal(), "TURNING": random.normal(0, 0.4)}
        offset = random.uniform(16, 20) if plain.off_road else random.uniform(-10, 10)
        placed(env, OFFSET=offset, ANGLE=random.uniform(-3, 3), WHEELS=random.uniform(-0.4, 0.4), **velocities)
        steer, pedal = random.uniform(-1, 1), random.uniform(-1, 1)
        demand, target = (pedal, 0.0) if pedals else (None, 60 / KMH)
        exact, wheels = plain.drive(*ground(env), steer, 1 / 30, demand, target)
        env.step(np.array([steer, pedal])[: 1 + pedals])
        found, turned = ground(env)
        error = found - exact
        error[2] = math.remainder(error[2], 2 * math.pi)
        assert turned == pytest.approx(wheels, abs=1e-12)
        errors.append(np.abs(error))
        backwards.append(velocities["FORWARD"] < 0.0)
    return np.array(errors), np.array(backwards)


@pytest.mark.parametrize("track", [5, "circuit"])
def test_the_way_along_the_road_is_the_way_on_the_ground(track: Any) -> None:
    """Ten seconds through bends: places to decimetres, because within a step the road's curvature is a constant."""
    env = Track(track=track, speed_profile=60)
    observation, _ = env.reset(seed=0, options={"distance": 400.0})
    plain = PlainCar(CAR)
    state, wheels = ground(env)
    for _ in range(300):
        steer = steer_ahead(observation, env.task.rules.observations, CAR)
        state, wheels = plain.drive(state, wheels, steer, 1 / 30, None, 60 / KMH)
        observation, *_ = env.step(np.array([steer]))
    found, _ = ground(env)
    np.testing.assert_allclose(found[:2], state[:2], atol=0.2)
    assert math.remainder(found[2] - state[2], 2 * math.pi) == pytest.approx(0, abs=0.01)


@pytest.mark.parametrize("steer", [-1.0, -0.5, 0.2, 0.6, 1.0])
def test_at_walking_speed_the_car_goes_where_its_wheels_point(steer: float) -> None:
    env = Track(track=[["turn", 200, 360]], width=100.0, speed_profile=5)
    env.reset(seed=0)
    steady(env, steer, 3)
    places: list[Array] = []
    radius = CAR.wheelbase / math.tan(abs(steer) * CAR.lock) + 0.5 * CAR.tread
    for _ in range(round(2 * math.pi * radius / (5 / KMH) * 30)):
        env.step(np.array([steer]))
        places.append(ground(env)[0][:2])
    path = np.array(places)
    middle = 0.5 * (path.max(axis=0) + path.min(axis=0))
    radii = np.linalg.norm(path - middle, axis=1)
    expected = math.hypot(CAR.rear, radius)
    np.testing.assert_allclose(radii, expected, rtol=0.03)


def loads(u: float, along: float) -> tuple[float, float]:
    """On the axles (N), at a speed (m/s) and with a force of engine or brakes."""
    shift = CAR.height / CAR.wheelbase * along
    return CAR.front_load + CAR.front_wing * u * u - shift, CAR.rear_load + CAR.rear_wing * u * u + shift


@pytest.mark.parametrize(("speed", "steer"), [(40, 0.04), (80, 0.02), (110, 0.02), (150, -0.0226)])
def test_steady_cornering_is_as_the_closed_form_has_it(speed: float, steer: float) -> None:
    """Wheelbase over radius, and the slip in front beyond that behind, each from the brush solved for its force."""
    env = Track(track=[["turn", 200, math.copysign(360, steer)]], width=200.0, speed_profile=speed)
    env.reset(seed=0)
    before = steady(env, steer, 4)
    u, v, r = steady(env, steer, 1)
    assert (u, v, r) == pytest.approx(before, rel=1e-4)
    wheels = middle(float(env.kernel_state()[rows.WHEELS]))
    share_f, share_r = CAR.rear / CAR.wheelbase, CAR.front / CAR.wheelbase
    side_f = CAR.mass * u * r * share_f / math.cos(wheels)
    side_r = CAR.mass * u * r * share_r
    along_r = CAR.drag * u * u + CAR.rolling * CAR.mass * GRAVITY + side_f * math.sin(wheels) - CAR.mass * v * r

    def slip(side: float, along: float, load: float, grip: float, stiffness: float) -> float:
        room = math.sqrt((grip * load) ** 2 - along**2)
        return math.copysign(3 * room / (stiffness * load) * (1 - (1 - abs(side) / room) ** (1 / 3)), side)

    front_load, rear_load = loads(u, along_r)
    slip_f = slip(side_f, 0.0, front_load, CAR.front_grip, CAR.front_stiffness)
    slip_r = slip(side_r, along_r, rear_load, CAR.rear_grip, CAR.rear_stiffness)
    assert (v - CAR.rear * r) / u == pytest.approx(-slip_r, rel=1e-3)
    assert math.atan((v + CAR.front * r) / u) + math.atan(slip_f) == pytest.approx(wheels, rel=1e-4)


def test_the_understeer_gradient_is_that_of_the_linear_tyre() -> None:
    """The wings press more behind than in front: the faster the car, the steadier."""
    env = Track(track=[["turn", 200, 360]], width=200.0, speed_profile=150)
    env.reset(seed=0)
    placed(env, OFFSET=40.0)
    u, _, r = steady(env, 0.002, 4)
    front_load, rear_load = loads(u, CAR.drag * u * u + CAR.rolling * CAR.mass * GRAVITY)
    soft_f = CAR.front_load / front_load / CAR.front_stiffness
    gradient = (soft_f - CAR.rear_load / rear_load / CAR.rear_stiffness) / GRAVITY
    assert gradient > 0
    wheels = middle(float(env.kernel_state()[rows.WHEELS]))
    assert (wheels - CAR.wheelbase * r / u) / (u * r) == pytest.approx(gradient, rel=0.1)


def test_a_curve_taken_too_fast_slides_at_the_limit_of_grip() -> None:
    """On a bend of radius 45 m, which allows 107 km/h; a driver who slows down in time stays on the road."""
    road = [["straight", 400], ["turn", 45, 180], ["straight", 400], ["turn", 45, 180]]
    pressed = 1.0 + CAR.front_wing * (140 / KMH) ** 2 / CAR.front_load  # by its wings
    limit = CAR.front_grip * GRAVITY * pressed  # the front slides first
    left_road, sideways = {}, {}
    for speed in (80, 140):
        env = Track(track=road, speed_profile=speed)
        observation, _ = env.reset(seed=0, options={"distance": 340.0})
        left_road[speed], felt = False, []
        for _ in range(round(220 / (speed / KMH) * 30)):
            v = env.kernel_state()[rows.SIDEWAYS]
            step = env.step(np.array([np.clip(steer_ahead(observation, env.task.rules.observations, CAR), -1, 1)]))
            observation, off = step[0], step[4]["off_road"]
            left_road[speed] |= off
            if off:
                break
            state = env.kernel_state()
            felt.append(abs((state[rows.SIDEWAYS] - v) * 30 + state[rows.FORWARD] * state[rows.TURNING]))
        sideways[speed] = max(felt)
    assert left_road == {80: False, 140: True}
    assert sideways[80] < 0.85 * limit
    assert 0.93 * limit < sideways[140] < 1.03 * limit  # the difference of a step is not quite a derivative


def test_braking_leaves_less_grip_for_turning() -> None:
    turned = []
    for pedal in (0.0, -1.0):
        env = Track(track="oval", width=30.0, speed_profile=None)
        env.reset(seed=0, options={"distance": 10.0})
        placed(env, FORWARD=35.0)
        for _ in range(12):
            env.step(np.array([0.3, pedal]))
        turned.append(env.kernel_state()[rows.ANGLE])
    assert turned[1] < 0.8 * turned[0]


def test_the_car_gets_as_fast_as_its_highest_gear_allows() -> None:
    env = Track(
        track=[["straight", 9000], ["turn", 100, 180], ["straight", 9000], ["turn", 100, 180]], speed_profile=None
    )
    env.reset(seed=0)
    speeds = []
    for _ in range(30 * 80):
        speeds.append(env.step(np.array([0.0, 1.0]))[4]["speed"] / KMH)
    top = np.roots([CAR.drag, 0.0, CAR.rolling * CAR.mass * GRAVITY, -CAR.power])
    assert max(top[np.isreal(top)].real) > CAR.top_speed
    assert speeds[-1] == pytest.approx(CAR.top_speed, rel=0.01)
    _, rear_load = loads(0.5 * (speeds[0] + speeds[30]), CAR.thrust)
    traction = min(CAR.thrust, CAR.reserve * CAR.rear_grip * rear_load) / CAR.mass
    assert (speeds[30] - speeds[0]) / 1.0 == pytest.approx(traction, rel=0.05)


def test_brakes_stop_the_car_and_do_not_push_it_back() -> None:
    env = Track(track="oval", speed_profile=None)
    env.reset(seed=0)
    placed(env, FORWARD=100 / KMH)
    start, speeds = float(env.kernel_state()[rows.DISTANCE]), []
    for _ in range(150):
        speeds.append(env.step(np.array([0.0, -1.0]))[4]["speed"] / KMH)
    braked = env.kernel_state()[rows.DISTANCE] - start
    assert min(speeds) > -1e-3
    assert speeds[-1] == pytest.approx(0, abs=1e-3)
    half_way = math.sqrt(0.5) * 100 / KMH  # of its energy
    most = CAR.front_grip * loads(half_way, 0.0)[0] + CAR.rear_grip * loads(half_way, 0.0)[1]
    front_load, rear_load = loads(half_way, -min(CAR.brakes + CAR.coasting, most))
    front = min(CAR.brake_balance * CAR.brakes, CAR.skid * CAR.front_grip * front_load)
    rear = min((1.0 - CAR.brake_balance) * CAR.brakes + CAR.coasting, CAR.skid * CAR.rear_grip * rear_load)
    others = CAR.rolling * CAR.mass * GRAVITY + CAR.drag * half_way**2
    deceleration = (front + rear + others) / CAR.mass
    assert braked == pytest.approx((100 / KMH) ** 2 / (2 * deceleration), rel=0.05)


def test_a_standing_car_stays_where_it_is_however_the_wheel_is_turned() -> None:
    env = Track(track="oval", speed_profile=None)
    env.reset(seed=0)
    placed(env, FORWARD=0.0)
    for t in range(300):
        env.step(np.array([1.0 if t % 20 < 10 else -1.0, 0.0]))
    assert np.abs(env.kernel_state()[[rows.FORWARD, rows.SIDEWAYS, rows.TURNING, rows.OFFSET]]).max() < 1e-6


def test_the_wheels_turn_no_faster_than_they_can() -> None:
    env = Track(track="oval", speed_profile=20)
    env.reset(seed=0)
    angles = []
    for t in range(30):
        angles.append(env.step(np.array([1.0 if t < 20 else -1.0]))[4]["state"][rows.WHEELS])
    assert math.degrees(angles[0]) == pytest.approx(4)  # 120 degrees/s, 30 steps a second
    assert math.degrees(angles[19]) == pytest.approx(45)
    assert math.degrees(angles[20]) == pytest.approx(41)


@pytest.mark.parametrize("speed", [20.0, 60.0, 120.0])
def test_a_wall_stops_what_moves_towards_it(speed: float) -> None:
    env = Track(track="oval", speed_profile=speed, stuck_seconds=60)
    env.reset(seed=0)
    wall = 6.0 + CAR.verge
    for _ in range(20 * 30):
        state = env.step(np.array([0.25]))[4]["state"]
        assert abs(state[rows.OFFSET]) <= wall
        assert np.isfinite(state).all()
    assert abs(env.kernel_state()[rows.OFFSET]) > 6.0


def test_there_is_less_grip_and_more_resistance_beside_the_road() -> None:
    slowed, turned = {}, {}
    for offset, steer in itertools.product((0.0, 9.0), (0.0, -0.2)):
        env = Track(track="oval", speed_profile=None)
        env.reset(seed=0)
        placed(env, FORWARD=30.0, OFFSET=offset)
        for _ in range(10):
            env.step(np.array([steer, 0.0]))
        slowed[offset, steer] = 30.0 - env.kernel_state()[rows.FORWARD]
        turned[offset, steer] = -env.kernel_state()[rows.ANGLE]
    air, road, grass = (CAR.drag * 30**2 / CAR.mass, GRAVITY * CAR.rolling, GRAVITY * CAR.off_road_rolling)
    engine = CAR.coasting / CAR.mass
    assert slowed[0.0, 0.0] == pytest.approx((air + road + engine) / 3, rel=0.03)
    assert slowed[9.0, 0.0] == pytest.approx((air + grass + engine) / 3, rel=0.03)
    assert turned[9.0, -0.2] < 0.8 * turned[0.0, -0.2]


@pytest.mark.parametrize("speed", [2.0, 3.0, 10.0, 70.0, 300.0])
@pytest.mark.parametrize("control_hz", [10, 30, 200])
def test_nothing_trembles_at_any_speed(speed: float, control_hz: float) -> None:
    """Driving straight on with a slight push to the side: it dies away instead of growing."""
    env = Track(
        track=[["straight", 5000], ["turn", 100, 180]] * 2, width=40.0, speed_profile=speed, control_hz=control_hz
    )
    env.reset(seed=0)
    placed(env, SIDEWAYS=0.01, TURNING=0.01)
    _, v, r = steady(env, 0.0, 3)
    assert max(abs(v), abs(r)) < 1e-4
