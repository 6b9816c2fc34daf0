from __future__ import annotations

import itertools

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray

from dpsearch.envs import DoublePole, DoublePoleHidden, SinglePole
from dpsearch.envs.poles.env import (
    PolesEnv,
)
from tests.support.plain_poles import (
    ENVS,
)


@pytest.mark.parametrize("render_mode", [None, "rgb_array", "human", "ansi"])
@pytest.mark.parametrize("kind", ENVS)
def test_gymnasiums_checks_pass_in_every_render_mode(
    kind: type[PolesEnv], render_mode: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setitem(PolesEnv.metadata, "render_fps", 1000)
    env = gym.make(f"dpsearch.envs:dpsearch/{kind.__name__}-v0", render_mode=render_mode)
    check_env(env.unwrapped)
    env.close()


def test_checks_pass_with_every_reward_and_many_starts() -> None:
    for reward in ("failure", "damping"):
        check_env(DoublePoleHidden(reward=reward, start_state="generalisation"), skip_render_check=True)


def picture(env: PolesEnv) -> NDArray[np.uint8]:
    frame = env.render()
    assert isinstance(frame, np.ndarray)
    assert (frame.shape, frame.dtype) == ((540, 960, 3), np.uint8)
    return frame


@pytest.mark.parametrize("kind", ENVS)
def test_pictures_show_what_goes_on(kind: type[PolesEnv]) -> None:
    env = kind(render_mode="rgb_array")
    env.reset(seed=0)
    frames = [picture(env)]
    for action in (0.4, 0.4, -0.9):
        env.step(np.array([action]))
        frames.append(picture(env))
        np.testing.assert_array_equal(picture(env), frames[-1])
    for one, two in itertools.combinations(frames, 2):
        assert (one != two).any()


def test_falls_of_all_kinds_can_be_drawn() -> None:
    ends = {
        "The long pole leans by more than 36°": [0, 0, 0.62, 2, 0, 0],
        "The short pole leans by more than 36°": [0, 0, 0, 0, -0.62, -9],
        "The cart has left the track in step 1.": [-2.39, -9, 0, 0, 0, 0],
    }
    for message, start in ends.items():
        env = DoublePole(start_state=start, render_mode="rgb_array")
        env.reset(seed=0)
        assert env.view().message()[0] == "The start."
        before = picture(env)
        assert env.step(np.array([0.0]))[2]
        assert message in env.text()
        assert (picture(env) != before).any()
    single = SinglePole(max_episode_steps=1)
    single.reset(seed=0)
    assert "everything is at rest" in single.text()
    single.step(np.array([0.0]))
    assert "Balanced to the end." in single.text()


def test_text_tells_place_angles_force_and_what_is_seen() -> None:
    env = DoublePoleHidden(render_mode="ansi", start_state=[1.2, 0, 0.1, 0, -0.2, 0])
    env.reset(seed=0)
    sketch = env.render()
    assert isinstance(sketch, str)
    track, cart, seen, time = sketch.splitlines()
    assert track.index("A") == 1 + round(0.75 * 47)
    assert "long pole / +5.73°, short pole \\ -11.46°, force none" in cart
    assert seen.strip() == "sees +0.2500 +0.1923 -0.3846, no velocities"
    assert time.strip() == "0 of 100,000 steps, 0.00 s, return 0"
    env.step(np.array([0.0]))
    assert "force +0.04 N" in env.render()
    assert "Balanced for 1 step, 0.02 seconds." in env.render()
    full = DoublePole(start_state=[1.2, 0.5, 0.1, 0, -0.2, 0])
    full.reset(seed=0)
    assert "sees +0.2500 +0.2500 +0.1923 +0.0000 -0.3846 +0.0000\n" in full.text()
