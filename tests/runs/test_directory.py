from pathlib import Path

import pytest
from omegaconf import OmegaConf

from dpsearch.runs import RunDirectory, RunError

CONFIG = OmegaConf.create({"seed": 3, "gamma": "${env.gamma}", "env": {"gamma": 0.9}})
HYDRA = OmegaConf.create({"overrides": {"task": ["seed=3"]}, "runtime": {"choices": {"env": "tmaze"}}})


def test_a_run_that_was_begun_is_found_again(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path / "a" / "b")
    directory.begin(CONFIG, HYDRA)
    config, choices = directory.read_config()
    assert config == {"seed": 3, "gamma": 0.9, "env": {"gamma": 0.9}}
    assert choices == {"env": "tmaze"}
    assert not directory.has_begun


def test_a_run_is_begun_beside_other_files(tmp_path: Path) -> None:
    (tmp_path / "output.log").touch()
    RunDirectory(tmp_path).begin(CONFIG, HYDRA)


def test_a_run_is_not_begun_twice(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    directory.begin(CONFIG, HYDRA)
    with pytest.raises(RunError, match="already holds a run"):
        directory.begin(CONFIG, HYDRA)


@pytest.mark.parametrize("name", ["checkpoint.pt", "policy.pt", "metrics.jsonl", "summary.json"])
def test_files_that_a_run_would_overwrite_are_left_alone(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("{}")
    with pytest.raises(RunError, match="already holds"):
        RunDirectory(tmp_path).begin(CONFIG, HYDRA)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_summary_with_a_number_that_json_does_not_know_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"cannot write .*summary\.json"):
        RunDirectory(tmp_path).write_summary({"return": float("nan")})


def test_learning_has_begun_when_there_is_something_to_lose(tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    directory.metrics.touch()
    assert not directory.has_begun
    directory.metrics.write_text("{}\n")
    assert directory.has_begun
    directory.metrics.unlink()
    directory.checkpoint.touch()
    assert directory.has_begun


def test_a_name_that_is_taken_gets_a_number(tmp_path: Path) -> None:
    for name in ("run", "run_2", "run_3"):
        directory = RunDirectory.free(tmp_path / "run")
        assert directory.path.name == name
        directory.path.mkdir()


@pytest.mark.parametrize("text", ["a: [", "- 1"])
def test_a_configuration_that_cannot_be_read_is_refused(tmp_path: Path, text: str) -> None:
    directory = RunDirectory(tmp_path)
    directory.begin(CONFIG, HYDRA)
    directory.config.write_text(text)
    with pytest.raises(RunError, match="cannot read"):
        directory.read_config()
