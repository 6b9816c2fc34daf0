from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import dpsearch.envs
from dpsearch.env_kit import KernelVectorEnv

ROOT = Path(__file__).parents[2]
NAMES = ["TMaze", "Tiger", "ShuttleDocking", "Maze4x3", "CheeseMaze", "Maze89"]
NAMES += ["SinglePole", "SinglePoleHidden", "DoublePole", "DoublePoleHidden"]
IDS = [f"dpsearch.envs:dpsearch/{name}-v0" for name in NAMES]


def python(code: str, directory: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code], cwd=directory, capture_output=True, text=True, timeout=120, check=False
    )


def test_importing_the_environments_loads_neither_torch_nor_numba() -> None:
    heavy = {"torch", "numba", "PIL", "pygame"}
    code = f"import sys, dpsearch.envs; print({heavy} & set(sys.modules))"
    assert python(code, ROOT).stdout.strip() == "set()"


def test_making_an_environment_does_not_load_torch() -> None:
    code = f"import sys, gymnasium; gymnasium.make({IDS[0]!r}); print('torch' in sys.modules)"
    assert python(code, ROOT).stdout.strip() == "False"


def test_importing_the_package_under_another_name_says_what_it_is_called() -> None:
    if not (ROOT / "pyproject.toml").is_file():
        pytest.skip("installed: no top-level package called envs exists")
    result = python("import envs", ROOT)
    assert result.stderr.strip().splitlines()[-1] == (
        "ImportError: this package is called dpsearch.envs: import that, not envs"
    )


def test_importing_again_registers_nothing_twice() -> None:
    code = "import importlib, dpsearch.envs; importlib.reload(dpsearch.envs)"
    result = python(code, ROOT)
    assert (result.returncode, result.stderr) == (0, "")


@pytest.mark.parametrize("name", IDS)
def test_every_environment_has_a_vector_class_and_a_threshold(name: str) -> None:
    spec = gym.spec(name.split(":")[1])
    assert spec.reward_threshold is not None
    assert spec.max_episode_steps is None  # it depends on the arguments: the environment knows
    assert isinstance(gym.make(name).unwrapped.spec.max_episode_steps, int)  # type: ignore[union-attr]
    vector = gym.make_vec(name, num_envs=3)
    assert isinstance(vector, KernelVectorEnv)
    assert type(vector).__name__ == name.split("/")[1].removesuffix("-v0") + "Vector"
    assert vector.reset(seed=0)[0].shape[0] == 3


def test_spawned_workers_find_the_environments_by_themselves() -> None:
    vector = gym.make_vec(
        IDS[0], num_envs=2, vectorization_mode="async", vector_kwargs={"context": "spawn"}, corridor_length=3
    )
    ours = gym.make_vec(IDS[0], num_envs=2, corridor_length=3)
    try:
        assert (vector.reset(seed=0)[0] == ours.reset(seed=0)[0]).all()
        actions = np.array([1, 0])
        assert (vector.step(actions)[1] == ours.step(actions)[1]).all()
    finally:
        vector.close()


def test_an_unknown_environment_is_named() -> None:
    with pytest.raises(gym.error.NameNotFound, match="Fmaze"):
        gym.make("dpsearch.envs:dpsearch/Fmaze-v0")


def test_public_names_are_found_and_others_are_not() -> None:
    for name in dpsearch.envs.__all__:
        assert getattr(dpsearch.envs, name).__name__ == name
        assert name in dir(dpsearch.envs)
    with pytest.raises(AttributeError, match="TMaz"):
        dpsearch.envs.TMaz  # noqa: B018
