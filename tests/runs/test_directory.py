from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from threading import Barrier
from typing import TypeVar

import pytest
from omegaconf import OmegaConf

from dpsearch.runs import RunDirectory, RunError

T = TypeVar("T")
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
        assert RunDirectory.free(tmp_path / "a" / "run").path == tmp_path / "a" / name
        assert (tmp_path / "a" / name).is_dir()


def test_a_name_below_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(RunError, match=r"cannot write the run directory .*file/run: Not a directory"):
        RunDirectory.free(tmp_path / "file" / "run")


def at_once(action: Callable[[int], T]) -> list[T | RunError]:
    """What the action returns or raises in each of eight threads that begin it together."""
    barrier = Barrier(8)

    def play(number: int) -> T | RunError:
        barrier.wait()
        try:
            return action(number)
        except RunError as error:
            return error

    with ThreadPoolExecutor(8) as pool:
        return list(pool.map(play, range(8)))


@pytest.mark.parametrize("folders", [[], ["run"], ["run/.hydra"]])
def test_one_of_several_that_begin_at_once_does_and_the_others_leave_it_alone(
    tmp_path: Path, folders: list[str]
) -> None:
    for folder in folders:
        (tmp_path / folder).mkdir(parents=True, exist_ok=True)
    directory = RunDirectory(tmp_path / "run")
    outcomes = at_once(lambda seed: directory.begin(OmegaConf.create({"seed": seed}), HYDRA))
    (winner,) = (seed for seed, outcome in enumerate(outcomes) if outcome is None)
    assert all("already holds a run" in str(outcome) for outcome in outcomes if outcome is not None)
    assert directory.read_config()[0] == {"seed": winner}
    assert [path.name for path in directory.path.iterdir()] == [".hydra"]


def test_names_given_at_once_are_all_different(tmp_path: Path) -> None:
    outcomes = at_once(lambda _: RunDirectory.free(tmp_path / "run"))
    names = {outcome.path.name for outcome in outcomes if isinstance(outcome, RunDirectory)}
    assert names == {"run", *(f"run_{k}" for k in range(2, 9))}


@pytest.mark.parametrize("path", ["", " "])
def test_an_empty_path_names_no_directory(path: str) -> None:
    with pytest.raises(RunError, match="resume must be the path of a directory, or null, got '"):
        RunDirectory.named("resume", path)


BOMB = "a: &a [1, 1]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n" for old, new in pairwise("abcdefghij")
)


@pytest.mark.parametrize("text", ["a: [", "- 1", "[" * 100_000, "a: \x00", BOMB])
def test_a_configuration_that_cannot_be_read_is_refused(tmp_path: Path, text: str) -> None:
    directory = RunDirectory(tmp_path)
    directory.begin(CONFIG, HYDRA)
    directory.config.write_text(text)
    with pytest.raises(RunError, match="cannot read"):
        directory.read_config()
