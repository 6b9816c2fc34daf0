"""Environments as people write them: legal, or nearly so, and each with a trap.

All but a few are a light that is on or off at each step, by the seed; the reward is 1 for the action that matches. They
differ in how they show it, what they take, and how they behave.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

STEPS = 5


class Light(gym.Env[Any, Any]):
    """Shows one number, -1 or 1, and pays for the sign of the action."""

    metadata: dict[str, Any] = {"render_modes": []}
    max_episode_steps: Any = 20

    def __init__(self) -> None:
        self.observation_space: gym.Space[Any] = spaces.Box(-1.0, 1.0, (1,))
        self.action_space: gym.Space[Any] = spaces.Discrete(2)

    def show(self) -> Any:
        return np.array([2.0 * self.light - 1.0], np.float32)

    def pays(self, action: Any) -> Any:
        return float((np.sum(action) > 0) == bool(self.light))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.steps, self.light = 0, int(self.np_random.integers(2))
        return self.show(), {}

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        assert self.action_space.contains(action), action
        reward = self.pays(action)
        self.steps, self.light = self.steps + 1, int(self.np_random.integers(2))
        return self.show(), reward, self.steps >= STEPS, False, {}


class Shown(Light):
    """Shows the light in a space of any kind."""

    kinds: dict[str, tuple[gym.Space[Any], Any]] = {
        "dict": (
            spaces.Dict(sign=spaces.Box(-1.0, 1.0, (2,)), number=spaces.Discrete(2)),
            lambda light: {"sign": np.array([light, -light]), "number": light},
        ),
        "dict of arrays": (
            spaces.Dict(number=spaces.Discrete(2), sign=spaces.Box(-1.0, 1.0, (1,))),
            lambda light: {"sign": np.array([light], np.float64), "number": np.array([light])},
        ),
        "dict with words": (
            spaces.Dict(mission=spaces.Text(9), sign=spaces.Box(-1.0, 1.0, (1,))),
            lambda light: {"sign": np.array([light], np.float32), "mission": "go there"},
        ),
        "tuple": (
            spaces.Tuple([spaces.Discrete(3, start=1), spaces.MultiBinary(2)]),
            lambda light: (light + 1, np.array([light, 1 - light], np.int8)),
        ),
        "nested": (
            spaces.Dict(a=spaces.Tuple([spaces.Box(-1.0, 1.0, ()), spaces.MultiDiscrete([2, 3])])),
            lambda light: {"a": (np.float32(light), np.array([light, 2]))},
        ),
        "discrete from 1": (spaces.Discrete(2, start=1), lambda light: light + 1),
        "discrete as array": (spaces.Discrete(2), lambda light: np.array([light])),
        "no axis": (spaces.Box(-1.0, 1.0, ()), lambda light: np.float32(light)),
        "list": (spaces.Box(-1.0, 1.0, (2,)), lambda light: [light, 0]),
        "integers for floats": (spaces.Box(-1.0, 1.0, (2,)), lambda light: np.array([light, 1], np.int64)),
        "beyond its bounds": (spaces.Box(0.0, 1.0, (1,)), lambda light: np.array([light + 1e-6])),
        "float64 of scale 1e6": (
            spaces.Box(-1e7, 1e7, (2,), np.float64),
            lambda light: np.array([1e6 * light, -1e6]),
        ),
        "image": (
            spaces.Box(0, 255, (4, 4, 3), np.uint8),
            lambda light: np.full((4, 4, 3), 255 * light, np.uint8),
        ),
        "image of floats": (spaces.Box(0, 255, (2, 2), np.uint8), lambda light: np.full((2, 2), 0.5 * light)),
    }

    def __init__(self, kind: str) -> None:
        super().__init__()
        self.observation_space, self._shown = self.kinds[kind]

    def show(self) -> Any:
        return self._shown(self.light)


class Taken(Light):
    """Takes actions of a space of any kind."""

    kinds: dict[str, gym.Space[Any]] = {
        "asymmetric box": spaces.Box(np.array([-3.0, 0.0], np.float32), np.array([1.0, 10.0], np.float32)),
        "unbounded box": spaces.Box(-np.inf, np.inf, (2,)),
        "box of the largest numbers": spaces.Box(-np.finfo(np.float32).max, np.finfo(np.float32).max, (1,)),
        "half bounded box": spaces.Box(np.array([0.0], np.float32), np.array([np.inf], np.float32)),
        "matrix": spaces.Box(-1.0, 1.0, (2, 2), np.float64),
        "discrete from 1": spaces.Discrete(2, start=1),
        "one choice": spaces.Discrete(1),
        "several from 1": spaces.MultiDiscrete([2, 3], start=[1, -1]),
    }

    def __init__(self, kind: str) -> None:
        super().__init__()
        self.action_space = self.kinds[kind]


class OneArray(Light):
    """Shows the same array again and again, and changes it in place."""

    def __init__(self) -> None:
        super().__init__()
        self._array = np.zeros(1, np.float32)

    def show(self) -> Any:
        self._array[0] = 2.0 * self.light - 1.0
        return self._array


class SharedArray(Light):
    """Shows an array that all environments of the class write to."""

    _array = np.zeros(1, np.float32)

    def show(self) -> Any:
        self._array[0] = 2.0 * self.light - 1.0
        return self._array


class WritesIntoActions(Light):
    """Changes the action that it gets, in place."""

    def __init__(self) -> None:
        super().__init__()
        self.action_space = spaces.Box(-1.0, 1.0, (2,))

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        outcome = super().step(action)
        action[:] = 0.0
        return outcome


class OneStep(Light):
    """Ends after one step, and says so with NumPy's booleans."""

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        observation, reward, *_ = super().step(action)
        return observation, reward, np.True_, np.False_, {}


class NoLimit(Light):
    """Says -1 where others say their limit, and ends by itself."""

    max_episode_steps = -1


class ArrayRewards(Light):
    """Pays with an array of one number."""

    def pays(self, action: Any) -> Any:
        return np.array([super().pays(action)])


class VariableInfos(Light):
    """Says other things at every step."""

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        *outcome, _ = super().step(action)
        return *outcome, {f"key {self.steps}": self, "array": np.zeros(self.steps), 3: None}


class Wrong(Light):
    """Breaks the rules, at the third step."""

    def __init__(self, how: str) -> None:
        super().__init__()
        self.how = how

    def show(self) -> Any:
        if self.steps < 2:
            return super().show()
        match self.how:
            case "raises":
                raise ZeroDivisionError("division by zero")
            case "nan":
                return np.array([np.nan])
            case "infinity":
                return np.array([np.inf])
            case "shape":
                return np.zeros(3)
            case "nothing":
                return None
        return super().show()

    def pays(self, action: Any) -> Any:
        wrong = {"two rewards": [1.0, 2.0], "a word": "much", "no reward": None}
        return wrong[self.how] if self.how in wrong and self.steps >= 2 else super().pays(action)


def same_step_vector() -> gym.vector.SyncVectorEnv:
    """A vector environment that starts an episode in the step that ends the one before."""
    return gym.vector.SyncVectorEnv([Light] * 3, autoreset_mode=AutoresetMode.SAME_STEP)


class LightVector(gym.vector.SyncVectorEnv):
    """A vector class of its own."""

    def __init__(self, num_envs: int = 1, max_episode_steps: int | None = None) -> None:
        super().__init__([Light] * num_envs)


_HERE = "tests.support.nasty_envs"
for _kind in Shown.kinds:
    gym.register(f"tests/Shown-{_kind.replace(' ', '_')}-v0", f"{_HERE}:Shown", kwargs={"kind": _kind})
for _kind in Taken.kinds:
    gym.register(f"tests/Taken-{_kind.replace(' ', '_')}-v0", f"{_HERE}:Taken", kwargs={"kind": _kind})
for _name in ("OneArray", "SharedArray", "WritesIntoActions", "OneStep", "ArrayRewards", "VariableInfos"):
    gym.register(f"tests/{_name}-v0", f"{_HERE}:{_name}")
gym.register("tests/Light-v0", f"{_HERE}:Light", vector_entry_point=f"{_HERE}:LightVector")
