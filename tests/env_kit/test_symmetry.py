"""The signs of a mirror, declared by an environment and seen through what is wrapped around it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces, vector, wrappers

from dpsearch.env_kit import ObserveOnly, PreviousAction
from dpsearch.env_kit.symmetry import mirror_signs
from dpsearch.envs import Track
from dpsearch.rollout import make_rollouts
from tests.support.toy_envs import Countdown

Env = gym.Env[Any, Any]


class Tightrope(gym.Env[Any, Any]):
    """Shows a height, how far one leans to the left, and how fast; takes a push."""

    observation_space = spaces.Box(-1.0, 1.0, (3,))
    action_space = spaces.Box(-1.0, 1.0, (1,))
    mirror_signs = (1.0, -1.0, -1.0, -1.0)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        return np.zeros(3, np.float32), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        return np.zeros(3, np.float32), 0.0, False, False, {}


class Doubled(wrappers.TransformObservation[Any, Any, Any]):
    """Changes what is seen, and declares its own signs."""

    mirror_signs = (1.0, -1.0, -1.0, -1.0)

    def __init__(self, env: Env) -> None:
        super().__init__(env, lambda seen: 2.0 * seen, None)


@pytest.mark.parametrize(
    ("wrap", "expected"),
    [
        (lambda env: env, Tightrope.mirror_signs),
        (lambda env: wrappers.TimeLimit(env, 5), Tightrope.mirror_signs),
        (lambda env: wrappers.TransformReward(env, float), Tightrope.mirror_signs),
        (lambda env: ObserveOnly(env, [2, 0]), (-1.0, 1.0, -1.0)),
        (lambda env: wrappers.TimeLimit(ObserveOnly(env, [1]), 5), (-1.0, -1.0)),
        (Doubled, Doubled.mirror_signs),
        (lambda env: wrappers.TransformObservation(env, lambda seen: seen[::-1], None), None),
        (lambda env: wrappers.RescaleAction(env, np.float32(-1.0), np.float32(1.0)), None),
        (PreviousAction, None),
        (lambda env: ObserveOnly(wrappers.TransformObservation(env, lambda seen: seen, None), [0]), None),
        (lambda env: vector.SyncVectorEnv([lambda: env]), Tightrope.mirror_signs),
        (lambda env: vector.SyncVectorEnv([lambda: ObserveOnly(env, [1])]), (-1.0, -1.0)),
        (
            lambda env: wrappers.vector.TransformObservation(vector.SyncVectorEnv([lambda: env]), lambda seen: -seen),
            None,
        ),
    ],
)
def test_signs_are_those_of_what_is_seen_and_done_or_there_are_none(
    wrap: Callable[[Env], Any], expected: tuple[float, ...] | None
) -> None:
    env = wrap(Tightrope())
    assert mirror_signs(env) == expected
    assert make_rollouts(env, max_episode_steps=5).mirror_signs == expected


def test_an_environment_need_not_declare_any() -> None:
    assert mirror_signs(Countdown()) is None
    assert make_rollouts("dpsearch/TMaze-v0").mirror_signs is None


def test_an_environment_that_is_made_may_be_given_its_signs() -> None:
    env = Countdown()
    vars(env)["mirror_signs"] = [1.0, -1.0]
    assert make_rollouts(env, max_episode_steps=5).mirror_signs == [1.0, -1.0]


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({}, (1.0, -1.0, -1.0, -1.0, -1.0)),
        ({"observations": ["target", "curvature", "angle"]}, (1.0, -1.0, -1.0, -1.0)),
        ({"observations": ["curvature", "speed"], "speed_profile": None}, (-1.0, 1.0, -1.0, 1.0)),
        ({"observations": ["speed", "rays"]}, None),  # rays change places
    ],
)
@pytest.mark.parametrize("wrap", [lambda env: env, lambda env: wrappers.TransformReward(env, float)])
def test_a_car_declares_its_signs_to_both_engines(
    settings: dict[str, Any], expected: tuple[float, ...] | None, wrap: Callable[[Env], Env]
) -> None:
    assert make_rollouts(lambda: wrap(Track(**settings))).mirror_signs == expected
