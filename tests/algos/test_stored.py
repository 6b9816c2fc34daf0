"""What is saved of an algorithm, and what is made of it again."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dpsearch.algos import RPG, XNESPolicySearch
from dpsearch.envs.tmaze import TMaze
from dpsearch.files import CheckpointError, read_checkpoint, versions, write_checkpoint
from dpsearch.policies import PolicyConfig
from dpsearch.rollout import EnvRecipe

TMAZE = "dpsearch.envs:dpsearch/TMaze-v0"
RECIPE = EnvRecipe(TMAZE, {"corridor_length": 3})


def make(**settings: Any) -> RPG:
    return RPG(TMAZE, **{"env_kwargs": {"corridor_length": 3}, **settings})


def edit(path: Path, **changes: Any) -> None:
    content = read_checkpoint(path)
    for name, value in changes.items():
        *above, last = name.split("__")
        entry = content
        for key in above:
            entry = entry[key]
        entry[last] = value
    written_by = content.pop("versions")
    write_checkpoint(path, {**content, "versions": written_by})


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    make().save(tmp_path / "rpg.pt")
    return tmp_path / "rpg.pt"


# Numbers of NumPy


def test_settings_may_be_numbers_of_numpy_and_are_saved(tmp_path: Path) -> None:
    numpy = make(
        seed=np.int64(1),
        batch_size=np.int32(5),
        learning_rate=np.float64(0.01),
        optimizer_options={"momentum": np.float32(0.5)},
        env_kwargs={"corridor_length": np.int64(3)},
        policy=PolicyConfig(hidden_size=np.int16(4)),  # type: ignore[arg-type]
        max_episode_steps=np.int64(50),
    )
    numpy.learn(total_updates=2).save(tmp_path / "rpg.pt")
    plain = make(
        seed=1,
        batch_size=5,
        learning_rate=0.01,
        optimizer_options={"momentum": 0.5},
        policy=PolicyConfig(hidden_size=4),
        max_episode_steps=50,
    )
    loaded = RPG.load(tmp_path / "rpg.pt").learn(total_updates=4)
    np.testing.assert_array_equal(loaded.policy.vector(), plain.learn(total_updates=4).policy.vector())
    assert (loaded.seed, loaded.config, loaded.rollouts.max_steps) == (1, plain.config, 50)


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"seed": object()}, "seed"),
        ({"optimizer_options": {"foreach": object()}}, "optimizer_options.foreach"),
        ({"env_kwargs": {"corridor_length": lambda: 3}}, "env_kwargs.corridor_length"),
    ],
)
def test_what_could_not_be_saved_is_refused_before_it_learns(settings: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=rf"^{named} must be made of numbers"):
        make(**settings)


# Where an algorithm is found again


def test_a_run_knows_its_environment(tmp_path: Path) -> None:
    recipe = EnvRecipe("CartPole-v1", observe_only=[0, 2], max_episode_steps=50, reward_threshold=40.0)
    rpg = RPG(recipe.rollouts(), recipe=recipe, batch_size=3).learn(total_updates=1)
    rpg.save(tmp_path / "checkpoint.pt")
    for path in (tmp_path, tmp_path / "checkpoint.pt", str(tmp_path)):
        loaded = RPG.load(path).learn(total_updates=2)
        assert (loaded.rollouts.max_steps, loaded.rollouts.reward_threshold) == (50, 40.0)
        loaded.save(tmp_path / "again.pt")
        assert RPG.load(tmp_path / "again.pt").recipe == recipe


def test_the_environment_of_a_run_may_be_given_other_arguments(tmp_path: Path) -> None:
    RPG(RECIPE.rollouts(), recipe=RECIPE).save(tmp_path / "rpg.pt")
    longer = RPG.load(tmp_path / "rpg.pt", env_kwargs={"corridor_length": 7, "max_episode_steps": 11})
    assert longer.rollouts.max_steps == 11
    assert RPG.load(tmp_path / "rpg.pt", TMaze).env_kwargs == {"corridor_length": 3}


@pytest.mark.parametrize("made_by", ["id", "recipe"])
def test_no_module_is_imported_that_only_the_file_names(tmp_path: Path, made_by: str) -> None:
    foreign = "tests.support.never_imported:tests/Never-v0"
    RPG(RECIPE.rollouts(), recipe=RECIPE).save(tmp_path / "rpg.pt")
    edit(tmp_path / "rpg.pt", **({"recipe__id": foreign} if made_by == "recipe" else {"recipe": None, "env": foreign}))
    with pytest.raises(CheckpointError, match="would be imported: if that is meant, give env"):
        RPG.load(tmp_path / "rpg.pt")
    assert "tests.support.never_imported" not in sys.modules
    with pytest.raises((RuntimeError, ValueError), match="never_imported"):  # now the user has named it
        RPG.load(tmp_path / "rpg.pt", env=foreign)


def test_a_policy_alone_is_named(tmp_path: Path) -> None:
    write_checkpoint(tmp_path / "policy.pt", {"architecture": {}})
    with pytest.raises(CheckpointError, match="holds a policy alone: give the directory of its run"):
        RPG.load(tmp_path / "policy.pt")


# Files that do not fit


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"config__bogus": 1}, "settings that this version does not take: .*bogus"),
        ({"config__gamma": 7.0}, "settings that this version does not take: gamma must be"),
        ({"policy__bogus": 1}, "settings that this version does not take: .*bogus"),
        ({"policy__hidden_size": 10**9}, "hidden_size is too large: .* GiB of memory"),
        ({"policy__hidden_size": 10**12}, "hidden_size is too large: .*inf GiB of memory"),
        ({"policy__hidden_size": 11}, "does not fit"),
        ({"policy__hidden_size": "many"}, "does not"),
        ({"config__batch_size": 10**15}, "batch_size is too large"),
        ({"state__policy": {}}, "does not fit"),
        ({"state__updates": None, "state": {}}, "does not fit"),
        ({"state": [1, 2]}, "does not fit"),
        ({"seed": -1}, "does not fit"),
        ({"config": None}, "settings"),
    ],
)
def test_a_file_that_does_not_fit_is_refused_in_one_line(saved: Path, changes: dict[str, Any], message: str) -> None:
    edit(saved, **changes)
    with pytest.raises(CheckpointError, match=message) as refused:
        RPG.load(saved)
    assert "\n" not in str(refused.value)


def test_other_versions_are_warned_of(saved: Path) -> None:
    edit(saved, versions={**versions(), "torch": "1.0"})
    with pytest.warns(UserWarning, match=r"rpg\.pt was written with torch 1\.0 \(here .*\): it may"):
        RPG.load(saved)


# What counts as solved


def solved(path: Path) -> RPG:
    rpg = make(learning_rate=1e-9)
    rpg.rollouts.reward_threshold = -1e9
    rpg.learn(total_steps=10**6, until_solved=True)
    assert rpg.solved
    rpg.rollouts.reward_threshold = 3.8
    rpg.save(path)
    return rpg


def test_another_task_is_not_solved_because_the_first_was(tmp_path: Path) -> None:
    before = solved(tmp_path / "rpg.pt")
    for other in (
        RPG.load(tmp_path / "rpg.pt", env_kwargs={"corridor_length": 20}),
        RPG.load(tmp_path / "rpg.pt", TMaze(corridor_length=20)),
        RPG.load(tmp_path / "rpg.pt", "dpsearch/TMaze-v0", env_kwargs={"corridor_length": 20}),
        RPG.load(tmp_path / "rpg.pt", TMaze, env_kwargs={"corridor_length": 20}),
    ):
        assert not other.solved
        assert other.learn(total_updates=before.updates + 1, until_solved=True).updates == before.updates + 1


def test_the_task_that_was_solved_still_is(tmp_path: Path) -> None:
    solved(tmp_path / "rpg.pt")
    assert RPG.load(tmp_path / "rpg.pt").solved
    RPG(RECIPE.rollouts(), recipe=RECIPE).save(tmp_path / "run.pt")
    edit(tmp_path / "run.pt", state__solved=True)
    assert RPG.load(tmp_path / "run.pt").solved
    assert RPG.load(tmp_path / "run.pt", RECIPE.rollouts(), recipe=RECIPE).solved
    assert not RPG.load(tmp_path / "run.pt", RECIPE.rollouts()).solved  # it was a lie, and is found out


def test_a_search_finds_out_too(tmp_path: Path) -> None:
    search = XNESPolicySearch(TMAZE, env_kwargs={"corridor_length": 3})
    search.solved = True
    search.save(tmp_path / "xnes.pt")
    assert not XNESPolicySearch.load(tmp_path / "xnes.pt", TMaze(corridor_length=20)).solved


def test_weights_are_not_made_to_be_counted() -> None:
    with pytest.raises(ValueError, match="hidden_size is too large: the policy's weights would take"):
        make(policy=PolicyConfig(hidden_size=10**7))
