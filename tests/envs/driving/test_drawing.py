from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dpsearch.envs import Track
from dpsearch.envs.driving.drawing import clock, picture, text


def drawn(env: Track) -> NDArray[np.uint8]:
    frame = env.render()
    assert isinstance(frame, np.ndarray)
    assert (frame.shape, frame.dtype) == ((540, 960, 3), np.uint8)
    return frame


@pytest.mark.parametrize(
    "arguments", [{}, {"track": "circuit", "speed_profile": None}, {"track": [["turn", 30, -360]]}]
)
def test_pictures_show_what_goes_on(arguments: dict[str, Any]) -> None:
    env = Track(render_mode="rgb_array", **arguments)
    env.reset(seed=0)
    frames = [drawn(env)]
    for action in (0.4, 0.4, -0.9):
        for _ in range(10):
            env.step(np.array([action, 1.0])[: env.action_space.shape[0]])  # type: ignore[index]
        frames.append(drawn(env))
        np.testing.assert_array_equal(drawn(env), frames[-1])
    for one, two in itertools.combinations(frames, 2):
        assert (one != two).any()


def test_the_picture_shows_the_trace_the_wheels_and_the_wall() -> None:
    env = Track(render_mode="rgb_array", speed_profile=60)
    env.reset(seed=0)
    for _ in range(30):
        env.step(np.array([0.01]))
    view = env.view()
    assert view.trace.shape == (31, 2)
    assert view.trace[-1].tolist() == list(view.car[:2])
    frame = picture(view)
    for change in ({"wheels": 0.7}, {"verge": None}, {"trace": view.trace[:1]}, {"lookahead": (9.0, 9.0)}):
        assert (picture(replace(view, **change)) != frame).any()
    np.testing.assert_array_equal(picture(replace(view, width=np.full(len(view.line), 12.0))), frame)
    env.reset()
    assert len(env.view().trace) == 1


def test_nothing_is_remembered_that_will_not_be_drawn() -> None:
    env = Track()
    env.reset(seed=0)
    env.step(np.array([0.0]))
    assert len(env.view().trace) == 0


def test_text_tells_speed_place_and_what_happened() -> None:
    env = Track(track="oval", speed_profile=36, render_mode="ansi", stuck_seconds=0.5, max_episode_steps=400)
    env.reset(seed=0)
    sketch = env.render()
    assert isinstance(sketch, str)
    road, speed, place, time = sketch.splitlines()
    assert road.endswith("The start.")
    assert road.index("|") < road.index("A") < road.rindex("|")
    assert speed == " 36.0 km/h (to hold: 36.0), position +0.00, wheels +0.0°"
    assert place == " 0 of 1,754 m, 0 laps"
    assert time == " 0 of 400 steps, return 0"
    said = []
    for _ in range(400):
        _, _, terminated, *_ = env.step(np.array([0.04]))
        said.append(env.text().splitlines()[0].split("  ")[-1])
        if terminated:
            break
    assert said[0].strip() == "On the road for 0.0 s."
    assert "Off the road, to its left." in {line.strip() for line in said}
    assert said[-1].strip().startswith("Stuck off the road, after")
    road = env.text().splitlines()[0]
    assert road.index("A") < road.index("|")


def test_a_zero_has_no_minus_sign() -> None:
    env = Track(track="oval", speed_profile=36)
    env.reset(seed=0)
    view = replace(env.view(), wheels=-1e-9, position=-1e-9, speed=-1e-9, distance=-1e-9, episode_return=-1e-9)
    sketch = text(view)
    assert " 0.0 km/h" in sketch
    assert "position +0.00, wheels +0.0°" in sketch
    assert "-0" not in sketch
    zero = replace(view, wheels=0.0, position=0.0, speed=0.0, distance=0.0, episode_return=0.0)
    np.testing.assert_array_equal(picture(view), picture(zero))


def test_the_end_of_a_drive_and_laps_are_told() -> None:
    env = Track(track=[["turn", 20, 360]], width=6.0, speed_profile=36, max_episode_steps=400)
    observation, _ = env.reset(seed=0)
    for _ in range(400):
        steer = np.arctan(2 * 2.5 * np.sin(observation[3] * 0.12) / 20) / np.radians(45)
        observation, *_ = env.step(np.array([steer]))
    assert "The end of the drive." in env.text()
    assert env.view().laps == 1
    earlier = replace(env.view(), step=399)
    assert earlier.message().text == f"On the road for 13.3 s, the last lap in {clock(earlier.lap_time)}."


def test_times_are_minutes_and_seconds() -> None:
    assert [clock(seconds) for seconds in (0.04, 9.96, 59.97, 83.25)] == ["0.0 s", "10.0 s", "1:00.0 min", "1:23.2 min"]
