"""CONTRIBUTING's examples run as printed."""

from __future__ import annotations

import importlib.util
import re
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import SyncVectorEnv

from dpsearch import RPG
from dpsearch.env_kit import KernelEnv, KernelVectorEnv
from dpsearch.kernels.philox import stream_key
from dpsearch.pomdp import TabularEnv, read_pomdp_file, write_pomdp_file
from dpsearch.rollout import LaneEngine
from tests.support.application import metrics, summary, train
from tests.support.exact import at_random, play

ROOT = Path(__file__).parents[1]
CONTRIBUTING = ROOT / "CONTRIBUTING.md"
EXAMPLES = {"two_doors": ("Add a finite task", "TwoDoors"), "pendulum": ("Add a continuous task", "Pendulum")}
"""File name of each example: the heading that it stands under, and the name of its scalar class."""


def block(heading: str, language: str) -> str:
    """The first block in a language under a heading."""
    section = CONTRIBUTING.read_text(encoding="utf-8").split(f"## {heading}\n")[1].split("\n## ")[0]
    found = re.search(rf"^( *)```{language}\n(.*?)^\1```", section, re.DOTALL | re.MULTILINE)
    assert found is not None
    return textwrap.dedent(found[2])


def module_in(heading: str, path: Path) -> ModuleType:
    """The first block of Python under a heading, saved as a file and imported."""
    path.write_text(block(heading, "python"))
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = sys.modules[path.stem] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def modules(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, ModuleType]]:
    """The modules of the examples, registered with Gymnasium as the page says."""
    folder = tmp_path_factory.mktemp("examples")
    found = {}
    for stem, (heading, name) in EXAMPLES.items():
        module = found[stem] = module_in(heading, folder / f"example_{stem}.py")
        gym.register(f"examples/{name}-v0", getattr(module, name), vector_entry_point=getattr(module, f"{name}Vector"))
    yield found
    for _, name in EXAMPLES.values():
        del gym.registry[f"examples/{name}-v0"]
    for stem in EXAMPLES:
        del sys.modules[f"example_{stem}"]


@pytest.fixture(params=EXAMPLES)
def scalar(request: pytest.FixtureRequest, modules: dict[str, ModuleType]) -> Callable[..., KernelEnv]:
    name = EXAMPLES[request.param][1]
    made: Callable[..., KernelEnv] = getattr(modules[request.param], name)
    return made


@pytest.mark.usefixtures("modules")
@pytest.mark.parametrize(("name", "render_mode"), [("TwoDoors", None), ("TwoDoors", "ansi"), ("Pendulum", None)])
def test_gymnasiums_checks_pass(name: str, render_mode: str | None) -> None:
    check_env(gym.make(f"examples/{name}-v0", render_mode=render_mode).unwrapped)


@pytest.mark.usefixtures("modules")
@pytest.mark.parametrize("name", ["TwoDoors", "Pendulum"])
def test_the_vector_class_equals_scalar_ones_bit_for_bit(name: str) -> None:
    n = 5
    ours = gym.make_vec(f"examples/{name}-v0", num_envs=n)
    assert isinstance(ours, KernelVectorEnv)
    theirs = SyncVectorEnv([lambda: gym.make(f"examples/{name}-v0").unwrapped] * n)
    assert data_equivalence(ours.reset(seed=3), theirs.reset(seed=3), exact=True)
    ours.action_space.seed(1)
    for _ in range(250):
        actions = ours.action_space.sample()
        assert data_equivalence(ours.step(actions), theirs.step(actions), exact=True)


def test_the_lane_engine_plays_the_same_episodes_as_the_scalar_class(scalar: Callable[..., KernelEnv]) -> None:
    algorithm = RPG(scalar, max_episode_steps=40)
    assert isinstance(algorithm.rollouts, LaneEngine)
    episodes = algorithm.rollouts.collect(algorithm.policy, 30, key=stream_key(7))
    env = scalar(max_episode_steps=40)
    discrete = isinstance(env.action_space, spaces.Discrete)
    tolerance = 0.0 if discrete else 1e-3  # real actions are recorded in single precision, but played in double
    for b, length in enumerate(episodes.lengths):
        observation, _ = env.reset(seed=7 if b == 0 else None)
        for t in range(length):
            np.testing.assert_allclose(episodes.observations[t, b], observation, atol=tolerance)
            action: Any = int(episodes.actions[t, b, 0]) if discrete else episodes.actions[t, b]
            observation, reward, terminated, truncated, _ = env.step(action)
            assert episodes.rewards[t, b] == pytest.approx(np.float32(reward), abs=tolerance)
            assert (terminated or truncated) == (t == length - 1)


def test_rpg_trains_on_them_in_lanes(scalar: Callable[..., KernelEnv]) -> None:
    algorithm = RPG(scalar)
    before = algorithm.policy.vector().copy()
    algorithm.learn(total_updates=2)
    assert (algorithm.policy.vector() != before).any()
    assert np.isfinite(algorithm.policy.vector()).all()


def test_two_doors_need_memory_and_rpg_finds_it(modules: dict[str, ModuleType]) -> None:
    env = modules["two_doors"].TwoDoors()
    assert isinstance(env, TabularEnv)
    assert play(env.pomdp, at_random(env.pomdp), env.max_episode_steps).mean_return == pytest.approx(0.0, abs=1e-9)
    learned = RPG(modules["two_doors"].TwoDoors, seed=0, optimizer="Adam", learning_rate=0.03, gradient_length=None)
    learned.learn(total_episodes=4000)
    assert learned.evaluate(100).mean_return > 0.9


@pytest.fixture
def configured(modules: dict[str, ModuleType], tmp_path: Path) -> Iterator[str]:
    """Two doors with the id and the file of configuration that the page says; what makes Hydra find the file."""
    (tmp_path / "env").mkdir()
    (tmp_path / "env" / "two_doors.yaml").write_text(block("Add a finite task", "yaml"))
    gym.register("dpsearch/TwoDoors-v0", modules["two_doors"].TwoDoors, reward_threshold=0.9)
    yield f"hydra.searchpath=[{tmp_path}]"
    del gym.registry["dpsearch/TwoDoors-v0"]


def test_two_doors_are_trained_from_the_command_line(configured: str, tmp_path: Path) -> None:
    run = tmp_path / "run"
    outcome = train(configured, "env=two_doors", "env.penalty=0.5", "total_updates=2", f"run_dir={run}")
    assert outcome.code == 0, outcome.err
    assert len(metrics(run)) == summary(run)["updates"] == 2
    outcome = train(configured, "env=two_doors", "env.penalty=-1", "total_updates=2", f"run_dir={tmp_path / 'other'}")
    assert (outcome.code, outcome.err) == (2, "error: env.penalty must not be negative, got -1.0\n")


def test_help_lists_the_settings_of_two_doors(configured: str) -> None:
    assert "Cost of opening the wrong door, not negative" in train(configured, "env=two_doors", "--help").out


def test_the_configured_discount_factor_is_the_tasks_own(configured: str, modules: dict[str, ModuleType]) -> None:
    assert f"gamma: {modules['two_doors'].two_doors_pomdp().discount}" in block("Add a finite task", "yaml")


def test_a_pendulum_is_trained_from_the_command_line(modules: dict[str, ModuleType], tmp_path: Path) -> None:
    outcome = train("env=gym", "env.id=examples/Pendulum-v0", "total_updates=2", f"run_dir={tmp_path / 'run'}")
    assert outcome.code == 0, outcome.err
    assert summary(tmp_path / "run")["updates"] == 2


def test_two_doors_come_back_from_a_file(modules: dict[str, ModuleType], tmp_path: Path) -> None:
    model = modules["two_doors"].two_doors_pomdp()
    write_pomdp_file(model, tmp_path / "two_doors.POMDP")
    again = read_pomdp_file(tmp_path / "two_doors.POMDP")
    np.testing.assert_array_equal(again.transition_matrix(0), model.transition_matrix(0))
    np.testing.assert_array_equal(again.first_observation_matrix(), model.first_observation_matrix())


def test_the_examples_refuse_bad_arguments_by_their_name(modules: dict[str, ModuleType]) -> None:
    with pytest.raises(ValueError, match=r"^penalty must not be negative, got -1$"):
        modules["two_doors"].TwoDoors(penalty=-1)
    with pytest.raises(ValueError, match=r"^gravity must be positive, got 0$"):
        modules["pendulum"].Pendulum(gravity=0)


def test_every_path_that_is_named_exists() -> None:
    named = re.findall(r"`((?:dpsearch|envs|configs|scripts|tests)/[\w./]*)`", CONTRIBUTING.read_text(encoding="utf-8"))
    examples = ("two_doors", "pendulum", "variant", "NAME", "FAMILY")
    assert [path for path in named if not (ROOT / path).exists() and not any(word in path for word in examples)] == []


def test_every_room_is_in_the_table() -> None:
    table = CONTRIBUTING.read_text(encoding="utf-8").split("## The house")[1].split("Habits:")[0]
    rooms = {path.name for path in (ROOT / "dpsearch").iterdir() if path.is_dir() and (path / "__init__.py").exists()}
    files = {path.name for path in (ROOT / "dpsearch").glob("*.py")} - {"__init__.py"}
    assert {room for room in rooms if f"{room}/`" not in table} == set()
    assert {file for file in files if f"{file}`" not in table} == set()
