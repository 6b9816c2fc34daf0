"""Driving in TORCS: rules, observations, reproducibility."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray

from dpsearch.env_kit import HiddenState
from dpsearch.envs import TORCS
from dpsearch.envs.driving.rules import OBSERVATIONS
from dpsearch.envs.torcs import State, best_lap
from dpsearch.policies.heads import Gaussian
from dpsearch.policies.policy import RecurrentPolicy
from dpsearch.rollout.gym_engine import GymEngine
from tests.support.torcs_wanted import require_torcs

require_torcs()

ID = "dpsearch.envs:dpsearch/TORCS-v0"
EVERYTHING = list(OBSERVATIONS)


@pytest.fixture(scope="module")
def car() -> Iterator[TORCS]:
    """At 40 km/h, seeing everything."""
    env = TORCS(speed_profile=40.0, observations=EVERYTHING)
    yield env
    env.close()


def state_of(info: dict[str, Any]) -> State:
    return State._make((*info["state"].tolist(), ()))


def along_the_middle(info: dict[str, Any]) -> NDArray[np.float32]:
    """A decent driver's action."""
    return np.array([0.4 * state_of(info).bearing], np.float32)


def drive(env: TORCS, steps: int, **options: Any) -> list[dict[str, Any]]:
    """The infos of an episode in the middle of the road."""
    _, info = env.reset(options=options)
    infos = [info]
    for _ in range(steps):
        infos.append(env.step(along_the_middle(infos[-1]))[4])
    return infos


def leave_the_road(env: TORCS, steering: float = 0.3) -> list[tuple[float, bool, dict[str, Any]]]:
    """Reward, end and info of all steps of an episode without a driver."""
    env.reset(options={"distance": 1500.0})
    steps: list[tuple[float, bool, dict[str, Any]]] = []
    while not steps or not steps[-1][1]:
        _, reward, terminated, _, info = env.step(np.array([steering], np.float32))
        steps.append((reward, terminated, info))
    return steps


@pytest.mark.parametrize(
    "arguments", [{}, {"speed_profile": None, "observations": EVERYTHING[:-1], "render_mode": "ansi"}]
)
def test_gymnasiums_checks_pass(arguments: dict[str, Any]) -> None:
    env = gym.make(ID, max_episode_steps=200, **arguments)
    check_env(env.unwrapped, skip_render_check="render_mode" not in arguments)
    env.close()


def play(env: TORCS, seed: int, steps: int = 200) -> list[bytes]:
    """All that is seen in an episode with random steering, bit for bit."""
    random = np.random.default_rng(seed)
    observation, info = env.reset(seed=seed)
    seen = [observation.tobytes() + info["state"].tobytes()]
    for _ in range(steps):
        observation, _, over, _, info = env.step(random.uniform(-0.2, 0.2, 1))
        seen.append(observation.tobytes() + info["state"].tobytes())
        if over:
            break
    return seen


def test_an_episode_is_the_same_bit_for_bit_in_every_process_and_after_every_other() -> None:
    one, other = (TORCS(start="random", speed_profile=60.0, observations=EVERYTHING) for _ in range(2))
    first = play(one, 1)
    assert play(one, 2) != first
    assert play(one, 1) == first
    play(other, 3, steps=10)
    leave_the_road(other)
    assert play(other, 1) == first
    one.close()
    assert play(one, 1) == first  # a new process
    one.close()
    other.close()


def test_three_instances_side_by_side_do_not_see_each_other() -> None:
    alone = TORCS(start="random")
    expected = [play(alone, seed, 60) for seed in range(3)]
    alone.close()
    envs = [TORCS(start="random") for _ in range(3)]
    randoms = [np.random.default_rng(seed) for seed in range(3)]
    resets = [env.reset(seed=seed) for seed, env in enumerate(envs)]
    seen = [[observation.tobytes() + info["state"].tobytes()] for observation, info in resets]
    for _ in range(60):
        for env, random, rows in zip(envs, randoms, seen, strict=True):
            observation, _, _, _, info = env.step(random.uniform(-0.2, 0.2, 1))
            rows.append(observation.tobytes() + info["state"].tobytes())
    for env in envs:
        env.close()
    assert seen == expected


def test_thirty_steps_are_exactly_a_second(car: TORCS) -> None:
    times = [state_of(info).time for info in drive(car, 60)]
    assert np.diff(times)[:6] == pytest.approx([0.034, 0.032, 0.034, 0.034, 0.032, 0.034])
    assert (times[30], times[60]) == (1.0, 2.0)


@pytest.mark.parametrize("speed", [10.0, 40.0, 70.0, 100.0, 130.0])
def test_the_speed_is_held(speed: float) -> None:
    env = TORCS(track="g-track-2", speed_profile=speed)
    speeds = [info["speed"] for info in drive(env, 300)]
    env.close()
    assert speeds == pytest.approx([speed] * 301, abs=2.0)
    assert speeds[150:] == pytest.approx([speed] * 151, abs=1.0)


def test_the_speed_follows_the_profile_from_episode_to_episode() -> None:
    env = TORCS(speed_profile=(20.0, 50.0, 60.0))
    assert drive(env, 900)[-1]["speed"] == pytest.approx(35.0, abs=1.0)
    assert drive(env, 300, driven_steps=900)[-1]["speed"] == pytest.approx(40.0, abs=1.0)
    assert drive(env, 30, driven_steps=9000)[-1]["speed"] == pytest.approx(50.0, abs=1.0)
    env.close()


def test_positive_steering_is_to_the_left_and_the_wheels_turn_by_120_degrees_a_second(car: TORCS) -> None:
    car.reset(options={"distance": 50.0})
    infos = [car.step(np.array([0.3]))[4] for _ in range(15)]
    states = [state_of(info) for info in infos]
    assert states[0].steering == pytest.approx(120.0 * states[0].time / 45.0, rel=0.01)
    assert states[-1].steering == pytest.approx(0.3)
    assert states[-1].yaw_rate > 0.3
    assert states[-1].angle > 0.1
    assert infos[-1]["position"] > 0.05
    assert states[-1].bearing < -0.1  # the middle of the road is to the right


def test_what_is_seen_is_what_it_is_called(car: TORCS) -> None:
    car.reset(options={"distance": 50.0})
    for _ in range(20):
        observation, reward, _, _, info = car.step(np.array([0.02]))
    state, seen, place = state_of(info), {}, 0
    for name, scale in OBSERVATIONS.items():
        seen[name] = observation[place : place + scale.size] * scale.deviation + scale.mean
        place += scale.size
    half = state.width / 2
    expected = {
        "speed": info["speed"],
        "steering": 0.02,
        "position": state.to_middle / half,
        "lookahead": state.bearing,
        "angle": state.angle,
        "curvature": 0.0,
        "target": 40.0,
    }
    assert reward == info["speed"] == state.speed * 3.6
    assert {name: float(seen[name][0]) for name in expected} == pytest.approx(expected, abs=1e-4)
    right, left = (half + state.to_middle), (half - state.to_middle)
    assert seen["rays"][0] == pytest.approx(right / math.sin(math.radians(60) - state.angle), abs=0.1)
    assert seen["rays"][8] == pytest.approx(left / math.sin(math.radians(60) + state.angle), abs=0.1)


def test_the_middle_of_the_road_ahead_is_where_it_is_in_space(car: TORCS) -> None:
    info = drive(car, 0, distance=1000.0)[-1]
    state, view = state_of(info), car.view()
    x, y = view.lookahead
    assert math.remainder(math.atan2(y - state.y, x - state.x) - state.yaw, 2 * math.pi) == pytest.approx(
        state.bearing, abs=1e-3
    )
    assert abs(state.curvature) > 0.001  # in a curve


def test_off_the_road_each_step_costs_100_until_the_car_is_stuck(car: TORCS) -> None:
    steps = leave_the_road(car)
    off = [info["off_road"] for _, _, info in steps]
    assert off[-150:] == [True] * 150  # five seconds
    assert [reward for reward, _, _ in steps[-150:]] == [-100.0] * 149 + [-1000.0]
    assert all(reward == info["speed"] for reward, _, info in steps if not info["off_road"])
    assert [over for _, over, _ in steps] == [False] * (len(steps) - 1) + [True]


def test_the_car_is_put_back_where_it_left_the_road(car: TORCS) -> None:
    steps = leave_the_road(car)
    left = next(k for k, (_, _, info) in enumerate(steps) if info["off_road"])
    carry_on = steps[-1][2]["carry_on"]
    assert carry_on == {"driven_steps": len(steps), "distance": steps[left - 1][2]["distance"]}
    _, info = car.reset(options=carry_on)
    assert info["distance"] == pytest.approx(carry_on["distance"], abs=1.0)
    assert abs(info["position"]) < 0.1
    assert info["speed"] == pytest.approx(40.0, abs=2.0)


def test_cars_are_put_anywhere_rolling_along_the_middle(car: TORCS) -> None:
    for distance in np.linspace(0.0, 3243.0, 40):
        info = drive(car, 0, distance=float(distance))[-1]
        assert math.remainder(info["distance"] - distance, 3243.64) == pytest.approx(0.0, abs=1.0)
        assert abs(info["position"]) < 0.2
        assert info["speed"] == pytest.approx(40.0, abs=2.0)
        assert abs(state_of(info).angle) < 0.3


def test_laps_are_counted() -> None:
    env = TORCS(speed_profile=70.0, lookahead=(8.0, 0.6))
    info = drive(env, 5200)[-1]
    env.close()
    assert info["laps"] == 1
    assert info["lap_time"] == pytest.approx(3243.6 / (70 / 3.6), rel=0.02)


def test_an_episode_is_cut_off_at_its_limit() -> None:
    env = TORCS(max_episode_steps=3)
    env.reset()
    steps = [env.step(np.zeros(1)) for _ in range(3)]
    assert [step[3] for step in steps] == [False, False, True]
    assert steps[-1][4]["carry_on"]["driven_steps"] == 3
    env.close()


def test_the_pedals_speed_up_and_slow_down() -> None:
    env = TORCS(speed_profile=None)
    env.reset()
    speeds = {pedal: [env.step(np.array([0.0, pedal]))[4]["speed"] for _ in range(60)][-1] for pedal in (0.5, -0.5)}
    env.close()
    assert speeds[0.5] > 30.0
    assert speeds[-0.5] < 10.0


def test_a_random_start_is_a_function_of_the_seed() -> None:
    env = TORCS(start="random")
    places = [env.reset(seed=seed)[1]["distance"] for seed in (0, 1, 0)]
    places.append(env.reset()[1]["distance"])
    env.close()
    assert places[0] == places[2]
    assert len({round(place) for place in places}) == 3


def test_other_cars_and_tracks_can_be_driven() -> None:
    env = TORCS(track="ruudskogen", car="155-DTM", speed_profile=50.0)
    infos = drive(env, 300)
    env.close()
    assert infos[-1]["speed"] == pytest.approx(50.0, abs=1.0)
    assert max(abs(info["position"]) for info in infos) < 0.5


def test_pictures_show_the_road_from_above() -> None:
    env = TORCS(render_mode="rgb_array")
    env.reset(seed=0)
    before = env.render()
    for _ in range(30):
        env.step(np.zeros(1))
    after = env.render()
    env.close()
    assert before.shape == after.shape == (540, 960, 3)
    assert (before != after).any()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"track": "monaco"}, "track must be one of .*e-track-1.*, got 'monaco'"),
        ({"car": "trabant"}, "car must be one of .*gt1.*, got 'trabant'"),
        ({"render_mode": "gif"}, "render_mode must be one of rgb_array, human, ansi, or None, got 'gif'"),
        ({"max_episode_steps": 0}, "max_episode_steps must be at least 1, got 0"),
        ({"observations": ["smell"]}, "observations must be some of"),
    ],
)
def test_bad_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        TORCS(**arguments)


def test_bad_actions_and_options_are_refused(car: TORCS) -> None:
    car.reset()
    for action in (np.zeros(2), np.array([np.nan]), 0.0, ["left"]):
        with pytest.raises(ValueError, match="an action must be in"):
            car.step(action)
    with pytest.raises(ValueError, match="distance must be from 0 to"):
        car.reset(options={"distance": -1.0})
    new = TORCS(render_mode="ansi")
    with pytest.raises(gym.error.ResetNeeded):
        new.step(np.zeros(1))
    with pytest.raises(gym.error.ResetNeeded):
        new.render()


def test_actions_beyond_the_bounds_are_taken_to_them(car: TORCS) -> None:
    def heading(steering: float) -> float:
        car.reset()
        return [state_of(car.step(np.array([steering]))[4]).yaw for _ in range(15)][-1]

    assert heading(5.0) == heading(1.0)


def test_the_hidden_state_can_be_shown() -> None:
    env = HiddenState(TORCS())
    observation, info = env.reset(seed=0)
    assert (observation == info["state"].astype(np.float32)).all()
    assert env.observation_space.shape == (len(State._fields) - 1,)
    env.close()


def test_in_the_vector_engine_an_episode_does_not_depend_on_how_many_there_are() -> None:
    policy = RecurrentPolicy(4, Gaussian(1))
    returns = []
    for lanes in (1, 3):
        rollouts = GymEngine(ID, num_envs=lanes, env_kwargs={"start": "random"}, max_episode_steps=50)
        returns.append(rollouts.collect(policy, 4, key=1).returns)
        rollouts.close()
    assert (returns[0] == returns[1]).all()


def test_torcs_own_driver_knows_the_track() -> None:
    assert 60.0 < best_lap(laps=2) < 75.0
    with pytest.raises(ValueError, match=r"driver must be one of .*berniw.*, got 'hamilton'"):
        best_lap(driver="hamilton")
    with pytest.raises(ValueError, match="laps must be at least 1, got 0"):
        best_lap(laps=0)
