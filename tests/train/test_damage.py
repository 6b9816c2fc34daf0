"""What was damaged, or changed by hand, is not gone on with; what others made does no harm."""

import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from omegaconf import OmegaConf

import dpsearch.evaluate
from dpsearch.algos import RPG, XNESPolicySearch
from dpsearch.files import CheckpointError, read_checkpoint, versions, write_checkpoint
from dpsearch.runs import load_policy
from tests.support.application import Outcome, metrics, train

SMALL = ("env.corridor_length=3", "until_solved=false", "total_updates=30", "evaluation_episodes=10")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("runs") / "whole"
    assert train(*SMALL, f"run_dir={run}").code == 0
    return run


@pytest.fixture
def run(whole: Path, tmp_path: Path) -> Path:
    shutil.copytree(whole, tmp_path / "run")
    return tmp_path / "run"


def assert_refused(outcome: Outcome, message: str) -> None:
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.err.count("\n") == 1, outcome.err
    assert re.search(message, outcome.err), outcome.err


def flip(path: Path, place: int) -> None:
    content = bytearray(path.read_bytes())
    content[place] ^= 4
    path.write_bytes(content)


# Damage


@pytest.mark.parametrize("name", ["checkpoint.pt", "policy.pt"])
def test_a_flipped_bit_in_a_weight_is_refused(run: Path, name: str) -> None:
    content = read_checkpoint(run / name)
    weights = content["weights"] if name == "policy.pt" else content["state"]["policy"]
    largest = max(weights.values(), key=lambda tensor: tensor.numel())
    flip(run / name, (run / name).read_bytes().index(largest.numpy().tobytes()) + 2)
    with pytest.raises(CheckpointError, match="is damaged"):
        load_policy(run / name) if name == "policy.pt" else RPG.load(run)
    if name == "checkpoint.pt":
        assert_refused(train(f"resume={run}"), "checkpoint.pt is damaged")


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda text: text.replace('"update": 7,', '"update": 8,'), r"damaged in line 7: it is not what the run wrote"),
        (lambda text: text.replace('"update": 7, "', '"update": 7, '), "damaged in line 7"),
        (lambda text: re.sub(r'"return": -?\d', '"return": 5', text, count=1), r"metrics\.jsonl is damaged"),
        (lambda text: "\n".join([*text.splitlines()[1:], "{}", ""]), "damaged in line 1"),
        (lambda text: text.replace("\n", "\n\n", 1), "damaged in line 2"),
        (lambda text: "[]\n" * 30, "damaged in line 1"),
        (lambda text: text[:1000], "ends at update"),
        (lambda text: "", "ends at update 0, before the checkpoint's 30"),
    ],
)
def test_damaged_metrics_are_refused_and_left_as_they_are(
    run: Path, damage: Callable[[str], str], message: str
) -> None:
    damaged = damage((run / "metrics.jsonl").read_text())
    (run / "metrics.jsonl").write_text(damaged)
    assert_refused(train(f"resume={run}", "total_updates=40"), message)
    assert (run / "metrics.jsonl").read_text() == damaged


# Changes by hand


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("seed", 1),
        ("algo.gamma", 0.5),
        ("algo.batch_size", 7),
        ("algo.optimizer_options", {"momentum": 0.5}),
        ("env.corridor_length", 4),
        ("env.reward_threshold", 1.0),
        ("policy.hidden_size", 11),
        ("rollout.num_envs", 3),
    ],
)
def test_a_setting_that_was_changed_by_hand_is_named(run: Path, key: str, value: object) -> None:
    config = OmegaConf.load(run / ".hydra" / "config.yaml")
    OmegaConf.update(config, key, value)
    OmegaConf.save(config, run / ".hydra" / "config.yaml")
    assert_refused(
        train(f"resume={run}"), rf"error: {re.escape(key)}.* is .* in .*config\.yaml, but the checkpoint was"
    )


def test_a_number_for_true_is_refused_in_a_file_too(run: Path) -> None:
    path = run / ".hydra" / "config.yaml"
    path.write_text(path.read_text().replace("progress: true", "progress: 2"))
    assert_refused(train(f"resume={run}"), "error: progress must be true or false, got 2")


def test_limits_may_be_changed_by_hand(run: Path) -> None:
    config = OmegaConf.load(run / ".hydra" / "config.yaml")
    config.total_updates = 33
    OmegaConf.save(config, run / ".hydra" / "config.yaml")
    assert train(f"resume={run}").code == 0
    assert len(metrics(run)) == 33


def test_another_algorithm_cannot_go_on(run: Path) -> None:
    path = run / ".hydra" / "hydra.yaml"
    path.write_text(path.read_text().replace("algo: rpg", "algo: lrwr"))
    assert train(f"resume={run}").code == 2


def test_a_checkpoint_of_no_run_is_no_run(run: Path) -> None:
    RPG.load(run).save(run / "checkpoint.pt")
    assert_refused(train(f"resume={run}"), "was not written by a run")


def test_other_versions_are_warned_of_in_one_line(run: Path) -> None:
    content = read_checkpoint(run / "checkpoint.pt")
    write_checkpoint(run / "checkpoint.pt", {**content, "versions": {**versions(), "numpy": "1.0"}})
    with pytest.warns(UserWarning, match=r"was written with numpy 1\.0"):
        assert train(f"resume={run}").code == 0


# A run as a library finds it


@pytest.mark.parametrize("name", ["", "checkpoint.pt"])
def test_a_run_is_loaded_by_its_directory_or_its_checkpoint(run: Path, name: str) -> None:
    rpg = RPG.load(run / name)
    assert (rpg.updates, rpg.rollouts.max_steps) == (30, 1000)
    assert rpg.learn(total_updates=31).evaluate(5).returns.shape == (5,)


@pytest.mark.parametrize("name", ["policy.pt", "metrics.jsonl", "missing", ".hydra"])
def test_what_is_no_checkpoint_is_refused(run: Path, name: str) -> None:
    with pytest.raises(CheckpointError, match=r"give the directory of its run|not a checkpoint|no checkpoint at"):
        RPG.load(run / name)


def test_a_run_of_another_algorithm_is_named(run: Path) -> None:
    with pytest.raises(CheckpointError, match="was saved by 'rpg', not by algorithm 'xnes'"):
        XNESPolicySearch.load(run)


# What others made


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"architecture": {"bogus": 1}}, "does not fit together: .*bogus"),
        ({"architecture": {"hidden_size": 10**9}}, "hidden_size is too large"),
        ({"architecture": {"hidden_size": 11}}, "does not fit together"),
        ({"observation_size": 10**15}, "does not fit together: there are fewer weights"),
        ({"actions": 10**15}, "does not fit together: there are fewer weights"),
        ({"actions": [10**15]}, "does not fit together: there are fewer weights"),
        ({"actions": "many"}, "does not fit together"),
        ({"weights": {}}, "does not fit together"),
        ({"weights": 1}, "does not fit together"),
        ({"env": {"bogus": 1}}, "does not fit together: .*bogus"),
    ],
)
def test_a_policy_that_does_not_fit_together_is_refused(run: Path, changes: dict[str, object], message: str) -> None:
    content = {**read_checkpoint(run / "policy.pt"), **changes}
    write_checkpoint(run / "policy.pt", content)
    with pytest.raises(CheckpointError, match=message):
        load_policy(run / "policy.pt")


def test_a_part_that_is_missing_is_named(run: Path) -> None:
    content = read_checkpoint(run / "policy.pt")
    del content["actions"]
    write_checkpoint(run / "policy.pt", content)
    with pytest.raises(CheckpointError, match="holds no policy: actions is missing"):
        load_policy(run / "policy.pt")


def test_the_environment_that_a_policy_names_is_imported_only_if_the_user_names_it_too(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content, foreign = read_checkpoint(run / "policy.pt"), "tests.support.never_imported:tests/Never-v0"
    content["env"]["id"] = foreign
    write_checkpoint(run / "policy.pt", content)
    policy, recipe = load_policy(run / "policy.pt")
    assert (policy.observation_size, recipe.id) == (3, foreign)
    for named, message in (([], f"give --env {foreign}"), (["--env", foreign], "No module named")):
        with pytest.raises(SystemExit, match="2"):
            dpsearch.evaluate.main([str(run), *named])
        assert message in capsys.readouterr().err
    assert "tests.support.never_imported" not in sys.modules


def test_another_environment_than_the_policy_was_trained_in_is_refused(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = read_checkpoint(run / "policy.pt")
    content["env"].update(id="CartPole-v1", kwargs={})
    write_checkpoint(run / "policy.pt", content)
    for how in ([], ["--gif", str(run / "policy.gif")]):
        with pytest.raises(SystemExit, match="2"):
            dpsearch.evaluate.main([str(run), *how])
        assert "the policy does not fit environment 'CartPole-v1'" in capsys.readouterr().err
