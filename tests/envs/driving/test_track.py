"""The embedded track as an environment: what is seen, the rules, and a driver who shows that it can be driven."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from dpsearch.env_kit import KernelVectorEnv
from dpsearch.env_kit.stepper import LaneStepper
from dpsearch.envs import Track
from dpsearch.envs.driving import kernel as rows
from dpsearch.envs.driving.car import Car
from dpsearch.envs.driving.rules import KMH, OBSERVATIONS, RAY_ANGLES, RAY_LENGTH, Referee
from dpsearch.envs.driving.track import TrackVector
from tests.support.plain_track import steer_ahead

EVERYTHING = tuple(OBSERVATIONS)
CIRCLE = [["turn", 40, 360]]
CAR = Car()


def seen(env: Track, observation: Any) -> dict[str, Any]:
    """What is seen in its own units."""
    values, first = {}, 0
    for name in env.task.rules.observations:
        scale = OBSERVATIONS[name]
        part = observation[first : first + scale.size] * scale.deviation + scale.mean
        values[name], first = (part if scale.size > 1 else float(part[0])), first + scale.size
    assert first == len(observation)
    return values


# What is seen


def test_the_four_numbers_of_the_thesis_are_seen() -> None:
    env = Track(speed_profile=30)
    observation, info = env.reset(seed=0)
    assert observation.shape == (4,)
    assert seen(env, observation) == pytest.approx(
        {"speed": 30, "steering": 0, "position": 0, "lookahead": 0}, abs=1e-3
    )
    assert info["speed"] == pytest.approx(30)
    observation, *_ = env.step(np.array([0.05]))
    assert seen(env, observation)["steering"] == pytest.approx(0.05)


def test_everything_that_can_be_seen_is_as_the_ground_has_it() -> None:
    random = np.random.default_rng(0)
    env = Track(track=5, speed_profile=(30, 60, 20), observations=EVERYTHING, start="random", lookahead=(12, 0.8))
    for episode in range(12):
        observation, _ = env.reset(seed=episode)
        for _ in range(20):
            observation, *_, info = env.step(random.normal(0, 0.15, 1))
        view, shape, state = seen(env, observation), env.task.shape, info["state"]
        place = complex(*shape.at(state[rows.DISTANCE], state[rows.OFFSET])[:2])
        heading = shape.at(state[rows.DISTANCE])[2] + state[rows.ANGLE]
        ahead = state[rows.DISTANCE] + 12 + 0.8 * info["speed"] / KMH
        direction = (complex(*shape.at(ahead)[:2]) - place) / complex(math.cos(heading), math.sin(heading))
        at = ahead % shape.length / shape.spacing
        bends = np.append(shape.curvature, shape.curvature[0])
        assert view["lookahead"] == pytest.approx(math.atan2(direction.imag, direction.real), abs=1e-5)
        assert view["curvature"] == pytest.approx(np.interp(at, np.arange(len(bends)), bends), abs=1e-7)
        assert view["angle"] == pytest.approx(state[rows.ANGLE], abs=1e-6)
        assert view["position"] == pytest.approx(state[rows.OFFSET] / 6, abs=1e-6)
        assert view["steering"] == pytest.approx(state[rows.WHEELS] / CAR.lock, abs=1e-7)
        assert view["speed"] == pytest.approx(info["speed"], abs=1e-4)
        assert view["target"] == pytest.approx(30 + 30 * 20 / 600, abs=1e-4)
        np.testing.assert_allclose(view["rays"], far(env, place, heading), atol=0.08)


def far(env: Track, place: complex, heading: float) -> list[float]:
    """The rays once more: how far one gets on the ground before the middle line is more than half a width away."""
    shape, half = env.task.shape, 0.5 * env.task.width
    line = shape.x + 1j * shape.y
    ends = np.roll(line, -1)

    def distance(point: complex) -> float:
        share = np.clip(((point - line) / (ends - line)).real, 0, 1)
        return float(np.abs(point - line - share * (ends - line)).min())

    lengths = []
    for angle in RAY_ANGLES:
        ray, length = complex(math.cos(heading + angle), math.sin(heading + angle)), 0.0
        while length < RAY_LENGTH and distance(place + length * ray) <= half:
            length += max(0.5 * (half - distance(place + length * ray)), 0.02)
        lengths.append(min(length, RAY_LENGTH))
    return lengths


def test_off_the_road_the_rays_see_nothing() -> None:
    env = Track(track="oval", speed_profile=60, observations=["rays"])
    env.reset(seed=0)
    off = False
    while not off:
        observation, *_, info = env.step(np.array([0.3]))
        off = info["off_road"]
    np.testing.assert_allclose(seen(env, observation)["rays"], 0, atol=1e-5)


# The rules


@pytest.mark.parametrize("pays", ["speed", "progress", "centred"])
def test_rewards_ends_laps_and_carrying_on_are_those_of_the_referee(pays: str) -> None:
    random = np.random.default_rng(1)
    env = Track(track=CIRCLE, speed_profile=(40, 50, 20), stuck_seconds=1.0, reward=pays, max_episode_steps=3000)
    referee = Referee(env.task.rules, env.task.shape.length)
    options: dict[str, Any] = {}
    ends, names = 0, env.task.rules.observations
    for episode in range(6):
        observation, info = env.reset(seed=episode, options=options)
        referee.reset(options.get("driven_steps", 0), info["distance"])
        over, unsteady = False, episode % 2 == 0
        while not over:
            action = steer_ahead(observation, names, CAR) + (unsteady and random.normal(0, 0.4))
            observation, reward, terminated, truncated, info = env.step(np.array([action]))
            _, _, p, u, v, *_ = info["state"]
            progress = KMH * (u * math.cos(p) - v * math.sin(p)) if pays != "speed" else None
            expected = referee.step(info["speed"], info["position"], info["distance"], progress)
            assert reward == pytest.approx(expected[0])
            assert terminated == expected[1]
            known = {name: info[name] for name in referee.info(0.0, 0.0)}
            assert known == pytest.approx(referee.info(info["speed"], info["position"]))
            over = terminated or truncated
        assert info["carry_on"] == pytest.approx(referee.carry_on())
        options, ends = info["carry_on"], ends + terminated
        assert unsteady or info["laps"] >= 3
    assert 0 < ends < 6


def test_an_episode_goes_on_where_the_car_left_the_road() -> None:
    env = Track(speed_profile=(20, 60, 10), stuck_seconds=0.5)
    env.reset(seed=0, options={"distance": 100.0})
    terminated, steps = False, 0
    while not terminated:
        _, reward, terminated, _, info = env.step(np.array([0.1]))
        steps += 1
    assert reward == -1000
    assert info["carry_on"]["driven_steps"] == steps
    assert 100 < info["carry_on"]["distance"] < info["distance"]
    _, info = env.reset(options=info["carry_on"])
    assert info["state"][rows.DRIVEN] == steps
    assert info["speed"] == pytest.approx(20 + 4 * steps / 30)
    assert (info["position"], info["laps"], "carry_on" in info) == (0, 0, False)


def test_options_of_reset_that_make_no_sense_are_refused_and_change_nothing() -> None:
    env = Track(start="random")
    env.reset(seed=0)
    with pytest.raises(ValueError, match="driven_steps must be"):
        env.reset(options={"driven_steps": -5})
    with pytest.raises(ValueError, match="options of reset may be driven_steps and distance, got gear"):
        env.reset(options={"gear": 2})
    _, info = env.reset()
    other = Track(start="random")
    other.reset(seed=0)
    assert other.reset()[1]["distance"] == info["distance"]


def test_starts_are_on_the_line_or_anywhere() -> None:
    assert {Track().reset(seed=seed)[1]["distance"] for seed in range(3)} == {0.0}
    env = Track(start="random")
    places = [env.reset(seed=seed)[1]["distance"] for seed in range(200)]
    length = env.task.shape.length
    assert 0 <= min(places) < 0.05 * length < 0.95 * length < max(places) < length
    _, info = env.reset(seed=3, options={"driven_steps": 900})
    assert (info["distance"], info["state"][rows.DRIVEN]) == (places[3], 900)


def test_the_pedals_start_at_ten_kilometres_an_hour() -> None:
    env = Track(speed_profile=None)
    assert env.action_space.shape == (2,)
    assert env.reset(seed=0)[1]["speed"] == pytest.approx(10)
    assert env.step(np.array([0.0, 1.0]))[1] > 10


def test_the_controller_holds_the_speed_of_the_profile() -> None:
    env = Track(track="oval", speed_profile=(10, 70, 20))
    env.reset(seed=0)
    for t in range(750):
        speed = env.step(np.array([0.0]))[4]["speed"]
        assert speed == pytest.approx(env.task.rules.target_speed(t), abs=2.0)
    assert speed == pytest.approx(70, abs=0.05)


# A driver


@pytest.mark.parametrize("track", [0, 5, 7, "circuit"])
def test_a_driver_who_heads_for_the_lookahead_point_stays_on_the_road(track: Any) -> None:
    env = TrackVector(2, track=track, speed_profile=(10, 70, 60), start="random")
    observations, _ = env.reset(seed=0)
    names, laps = env.task.rules.observations, 0
    while laps < 2:
        actions = steer_ahead(observations, names, CAR)
        observations, _, terminated, _, info = env.step(np.reshape(actions, (2, 1)))
        assert not info["off_road"].any()
        assert not terminated.any()
        laps = info["laps"].min()
    assert (info["lap_time"] < env.task.shape.length / (68 / KMH)).all()


def test_under_an_unsteady_driver_observations_have_mean_0_and_deviation_1() -> None:
    random, n = np.random.default_rng(0), 16
    pooled: dict[str, list[Any]] = {name: [] for name in EVERYTHING}
    for track in (1, 4, 8):
        env = TrackVector(n, track=track, observations=EVERYTHING, start="random", speed_profile=(10, 70, 60))
        observations, _ = env.reset(seed=track)
        wander = np.zeros(n)
        for t in range(1800):
            wander = 0.95 * wander + math.sqrt(1 - 0.95**2) * random.standard_normal(n)
            speed = np.maximum(observations[:, 0] * 17.3 + 40, 5.0)
            actions = steer_ahead(observations, EVERYTHING, CAR) + wander / speed  # hands are steadier when fast
            observations, *_, info = env.step(np.reshape(actions, (n, 1)))
            assert not info["off_road"].any()
            if t % 6 == 0:
                first = 0
                for name, scale in OBSERVATIONS.items():
                    pooled[name].append(observations[:, first : first + scale.size])
                    first += scale.size
    for name, values in pooled.items():
        assert abs(np.mean(values)) < 0.35, name
        assert 0.7 < np.std(values) < 1.4, name


# As a Gymnasium environment


@pytest.mark.parametrize("render_mode", [None, "rgb_array", "human", "ansi"])
def test_gymnasiums_checks_pass_in_every_render_mode(render_mode: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setitem(Track.metadata, "render_fps", 1000)
    env = gym.make("dpsearch.envs:dpsearch/Track-v0", render_mode=render_mode)
    check_env(env.unwrapped)
    env.close()


def test_checks_pass_with_pedals_all_observations_and_random_starts() -> None:
    names = [name for name in EVERYTHING if name != "target"]
    check_env(Track(speed_profile=None, observations=names, start="random"), skip_render_check=True)


def test_it_is_registered_with_its_vector_class_and_without_a_threshold() -> None:
    name = "dpsearch.envs:dpsearch/Track-v0"
    spec = gym.make(name, speed_profile=50).unwrapped.spec
    assert spec is not None
    assert (spec.max_episode_steps, spec.reward_threshold) == (54_000, None)
    vector = gym.make_vec(name, num_envs=3)
    assert isinstance(vector, TrackVector)
    assert isinstance(vector, KernelVectorEnv)
    assert vector.reset(seed=0)[0].shape == (3, 4)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_a_vector_equals_scalar_environments_bit_for_bit(mode: AutoresetMode) -> None:
    names = [name for name in EVERYTHING if name != "target"]
    arguments: dict[str, Any] = {"track": 5, "start": "random", "stuck_seconds": 0.2, "observations": names}
    arguments |= {"speed_profile": None, "max_episode_steps": 90}
    n = 5
    ours = TrackVector(n, mode, **arguments)
    theirs = SyncVectorEnv([lambda: Track(**arguments)] * n, autoreset_mode=mode)
    random, ends = np.random.default_rng(0), np.zeros(2, int)
    assert data_equivalence(ours.reset(seed=3), theirs.reset(seed=3), exact=True)
    for _ in range(300):
        actions = random.normal([0.0, 0.6], [0.2, 0.5], (n, 2)).astype(np.float32)
        mine, other = ours.step(actions), theirs.step(actions)
        assert data_equivalence(mine, other, exact=True)
        ends += [mine[2].sum(), mine[3].sum()]
    assert ends.min() > 0


def test_arguments_of_the_vector_are_those_of_the_scalar_class() -> None:
    vector = TrackVector(2, track="oval", width=9.0, speed_profile=33, observations=["angle"], lookahead=(5, 1))
    task = Track("oval", 9.0, 33, ["angle"], (5, 1)).task
    assert vector.task.rules == task.rules
    np.testing.assert_array_equal(vector.task.kernel.floats, task.kernel.floats)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e300])
def test_a_policy_gone_mad_does_no_harm(bad: float) -> None:
    """The compiled engine checks no actions: numbers that are none end in the car being stuck, not in a crash."""
    task = Track.make_task(speed_profile=None, observations=[name for name in EVERYTHING if name != "target"])
    stepper = LaneStepper(task.kernel, 3)
    for i in range(3):
        stepper.seed(i, i)
    stepper.reset(np.ones(3, np.bool_))
    stuck = np.zeros(3, np.bool_)
    for _ in range(600):
        rewards, terminated = stepper.step(np.array([[bad, bad], [0.0, 0.1], [bad, 0.0]]))
        stuck |= terminated
        stepper.observe()
        assert np.isfinite(rewards).all()
    assert not stuck[1]
    assert np.isfinite(stepper.state()[1]).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"width": -1.0}, "width must be a finite number of metres, at least 4, got -1.0"),
        ({"width": "wide"}, "width must be a finite number"),
        ({"width": math.nan}, "width must be a finite number"),
        (
            {"track": 5, "width": 40},
            r"verge of 8 m inside the tightest curve, of radius 27\.4 m: at most 27\.9 m, got 40",
        ),
        ({"track": [["turn", 15, 360]]}, "at most 8.0 m"),
        ({"track": "imola"}, "track must be a seed"),
        ({"observations": ["wheel"]}, "observations must be some of"),
        ({"max_episode_steps": 0}, "max_episode_steps must be at least 1, got 0"),
        ({"render_mode": "gif"}, "render_mode must be one of rgb_array, human, ansi, or None, got 'gif'"),
    ],
)
def test_impossible_arguments_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Track(**arguments)


def test_a_track_that_comes_too_near_to_itself_is_refused() -> None:
    bone = [*[["straight", 200], ["turn", 50, -60], ["turn", 50, 300], ["turn", 50, -60]] * 2]
    with pytest.raises(ValueError, match="must not cross itself, nor come nearer to itself than its width of 12 m"):
        Track(bone)
