"""The rules that the embedded track and TORCS share."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from dpsearch.envs.driving.rules import OBSERVATIONS, RAY_ANGLES, Referee, SpeedProfile, Start, driving_rules


def test_the_default_is_the_thesis_s_drive() -> None:
    rules = driving_rules()
    assert rules.profile == SpeedProfile(10.0, 70.0, 1800.0)
    assert rules.observations == ("speed", "steering", "position", "lookahead")
    assert (rules.control_hz, rules.observation_space.shape, rules.action_space.shape) == (30.0, (4,), (1,))
    speeds = [rules.target_speed(round(30 * seconds)) for seconds in (0, 900, 1800, 3600)]
    assert speeds == pytest.approx([10, 40, 70, 70])


def test_a_number_is_a_constant_speed_and_without_a_profile_there_are_pedals() -> None:
    assert [driving_rules(speed_profile=55).target_speed(steps) for steps in (0, 10**6)] == [55, 55]
    assert driving_rules(speed_profile=(60, 20, 10)).target_speed(150) == pytest.approx(40)
    pedals = driving_rules(speed_profile=None)
    assert pedals.action_space.shape == (2,)
    assert pedals.target_speed(9999) == 10.0


def test_one_looks_further_ahead_when_fast_but_never_back() -> None:
    rules = driving_rules(lookahead=(8, 1.5))
    assert [rules.lookahead_distance(speed) for speed in (-50.0, 0.0, 36.0)] == pytest.approx([8, 8, 23])


def test_observations_are_shifted_and_scaled_in_the_order_that_was_asked_for() -> None:
    rules = driving_rules(observations=["rays", "position", "speed"])
    rays = np.linspace(0, 100, len(RAY_ANGLES))
    shown = rules.show({"position": -0.5, "rays": rays.tolist(), "speed": 57.3, "angle": 9.0})
    scale = OBSERVATIONS["rays"]
    expected = [*((rays - scale.mean) / scale.deviation), -0.5 / OBSERVATIONS["position"].deviation, 1.0]
    np.testing.assert_allclose(shown, expected, rtol=1e-6)
    assert shown in rules.observation_space
    assert RAY_ANGLES[0] == -RAY_ANGLES[-1] == math.radians(-60)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"observations": ["speed", "wheel"]}, r"observations must be some of speed, .*, target, each once, got"),
        ({"observations": ["speed", "speed"]}, "each once"),
        ({"observations": []}, "observations must be some of"),
        ({"observations": ["target"], "speed_profile": None}, "target without a speed_profile"),
        ({"speed_profile": (10, 70)}, "speed_profile must be start and end .* number .* None for the pedals"),
        ({"speed_profile": (10, 70, 0)}, "speed_profile must be"),
        ({"speed_profile": (10, 500, 1)}, r"in \[2, 400\] km/h"),
        ({"speed_profile": 0}, "speed_profile must be"),
        ({"speed_profile": 1.9}, "speed_profile must be"),  # nearly standing
        ({"speed_profile": math.nan}, "speed_profile must be"),
        ({"speed_profile": True}, "speed_profile must be"),
        ({"speed_profile": "fast"}, "speed_profile must be"),
        ({"lookahead": 10}, "lookahead must be a base"),
        ({"lookahead": (0, 1)}, "lookahead must be a base"),
        ({"lookahead": (10, -1)}, "lookahead must be a base"),
        ({"start": "pits"}, "start must be one of line, random, got 'pits'"),
        ({"control_hz": 5}, "control_hz must be from 10 to 200, got 5"),
        ({"stuck_seconds": 0}, "stuck_seconds must be finite and positive, got 0"),
        ({"stuck_seconds": math.inf}, "stuck_seconds must be"),
        ({"reward": "laps"}, "reward must be one of speed, progress, centred, got 'laps'"),
    ],
)
def test_what_is_not_understood_is_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        driving_rules(**arguments)


def test_options_of_reset_are_checked() -> None:
    rules = driving_rules()
    assert rules.start_of(None, 100.0) == rules.start_of({}, 100.0) == Start(0, None)
    assert rules.start_of({"driven_steps": np.int64(7), "distance": 99}, 100.0) == Start(7, 99.0)
    for options, message in (
        ({"driven_steps": -1}, "driven_steps must be a whole number, at least 0, got -1"),
        ({"driven_steps": 1.0}, "driven_steps must be"),
        ({"driven_steps": True}, "driven_steps must be"),
        ({"distance": 101.0}, "distance must be from 0 to the road's 100.0 m, got 101.0"),
        ({"distance": math.nan}, "distance must be"),
        ({"lane": 1}, "options of reset may be driven_steps and distance, got lane"),
    ):
        with pytest.raises(ValueError, match=message):
            rules.start_of(options, 100.0)


def test_a_step_earns_the_speed_on_the_road_and_a_penalty_beside_it() -> None:
    referee = Referee(driving_rules(stuck_seconds=0.1), 1000.0)
    referee.reset(0, 0.0)
    assert referee.step(50.0, -1.0, 1.0) == (50.0, False)
    assert referee.step(50.0, 1.01, 2.0) == (-100.0, False)
    assert referee.off_road
    assert referee.step(50.0, -5.0, 3.0) == (-100.0, False)
    assert referee.step(50.0, 0.0, 4.0) == (50.0, False)  # it got back in time
    assert [referee.step(50.0, 2.0, 5.0 + t) for t in range(3)] == [(-100.0, False), (-100.0, False), (-1000.0, True)]
    assert referee.carry_on() == {"driven_steps": 7, "distance": 4.0}


def test_a_car_that_stands_on_the_road_is_stuck_in_the_end() -> None:
    referee = Referee(driving_rules(stuck_seconds=0.1), 1000.0)
    referee.reset(0, 0.0)
    assert [referee.step(0.5, 0.9, 1.0) for _ in range(2)] == [(0.5, False)] * 2
    assert referee.step(1.5, 0.9, 1.0) == (1.5, False)  # it got away in time
    assert [referee.step(speed, 0.9, 1.0)[1] for speed in (0.5, -3.0, math.nan)] == [False, False, True]
    assert not referee.off_road


def test_progress_is_paid_where_it_is_asked_for() -> None:
    referee = Referee(driving_rules(reward="progress"), 1000.0)
    referee.reset(0, 0.0)
    assert referee.step(50.0, 0.0, 1.0, -20.0) == (-20.0, False)
    assert referee.step(50.0, 2.0, 1.0, 20.0) == (-100.0, False)


def test_a_step_near_the_edge_pays_less_of_the_progress_where_the_middle_is_wanted() -> None:
    referee = Referee(driving_rules(reward="centred"), 1000.0)
    referee.reset(0, 0.0)
    paid = [referee.step(50.0, position, 1.0, 40.0)[0] for position in (0.0, 0.5, -0.5, 1.0, 1.1)]
    assert paid == [40.0, 30.0, 30.0, 0.0, -100.0]


def test_a_position_that_is_not_a_number_is_off_the_road() -> None:
    referee = Referee(driving_rules(), 1000.0)
    referee.reset(0, 0.0)
    assert referee.step(math.nan, math.nan, 1.0)[0] == -100.0


def test_laps_are_counted_from_the_distance_and_not_by_going_to_and_fro() -> None:
    referee = Referee(driving_rules(speed_profile=50), 100.0)
    referee.reset(300, 95.0)
    for distance in (99.0, 3.0, 99.0, 3.0, 40.0, 80.0):  # over the line, back, and over it again
        referee.step(50.0, 0.0, distance)
    assert (referee.laps, referee.lap_time) == (0, 0.0)
    assert referee.progress == pytest.approx(85.0)
    referee.step(50.0, 0.0, 96.0)
    assert referee.laps == 1
    assert referee.lap_time == pytest.approx(7 / 30)
    info = referee.info(50.0, 0.25)
    assert info == {
        "speed": 50.0,
        "position": 0.25,
        "distance": 96.0,
        "laps": 1,
        "lap_time": pytest.approx(7 / 30),
        "off_road": False,
    }
    referee.reset(0, 0.0)
    assert (referee.laps, referee.lap_time, referee.progress) == (0, 0.0, 0.0)
