"""What the command line refuses, in one line and before anything is written; and sweeps, which go on."""

import os
import re
from pathlib import Path

import pytest
import torch

from dpsearch.algos import RPG
from tests.support.application import Outcome, start, summary, train

FEW = ("env.corridor_length=2", "until_solved=false", "total_updates=1", "evaluation_episodes=2", "progress=false")


def assert_refused(outcome: Outcome, message: str) -> None:
    assert (outcome.code, outcome.out) == (2, "")
    assert outcome.err.count("\n") == 1, outcome.err
    assert re.search(message, outcome.err), outcome.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("rollout.threads=1000000", r"error: rollout\.threads must be at least 1 and at most 1024, got 1000000"),
        ("rollout.num_envs=1000000000", r"error: rollout\.num_envs must be .* at most 65536"),
        ("evaluation_episodes=1000000000", r"error: evaluation_episodes must be at least 2 and at most 2\*\*24"),
        ("algo.batch_size=9223372036854775807", r"error: algo\.batch_size is too large: .* GiB .* free$"),
        ("algo=lrwr algo.batch_size=9223372036854775807", r"error: algo\.batch_size is too large"),
        ("algo=xnes algo.population=9223372036854775807", r"error: algo\.population is too large"),
        ("algo=snes algo.episodes_per_fitness=1000000000000", r"error: algo\.episodes_per_fitness is too large"),
        ("algo.learning_rate=1e308", r"error: algo\.learning_rate must be below 3\.4e\+38"),
        ("algo=lrwr algo.learning_rate=1e39", r"error: algo\.learning_rate must be below"),
        ("algo.optimizer_options={momentum:nan}", r"error: algo\.optimizer_options must be finite, got momentum=nan"),
        ("algo.optimizer=Adam algo.optimizer_options={betas:[0.9,inf]}", r"error: algo\.optimizer_options must be"),
        ("policy.hidden_size=1000000000", r"error: policy\.hidden_size is too large: the policy's weights would take"),
        ("policy.hidden_size=1000000000000", r"error: policy\.hidden_size is too large"),
        ("algo=cmaes policy.hidden_size=300", r"error: policy\.hidden_size is too large: cmaes's matrices .*algo=snes"),
        ("algo=fem policy.hidden_size=300", r"error: policy\.hidden_size is too large: fem's matrices .*diagonal"),
        ("algo.baseline={kind:history,cells:1000000}", r"error: algo\.baseline\.cells is too large: the baseline's"),
        ("run_dir=", "error: run_dir must be the path of a directory, or null, got ''"),
        ("resume=", "error: resume must be the path of a directory, or null, got ''"),
        ("until_solved=2", "error: until_solved must be true or false, got 2"),
        ("progress=3", "error: progress must be true or false, got 3"),
        ("env=tiger env.single=-1", r"error: env\.single must be true or false, got -1"),
        ("policy.bias=2", r"error: policy\.bias must be true or false, got 2"),
        ("hydra.run.dir=file/q", "error: .*Not a directory: '.*file/q'"),
        ("--resolve", "error: The --resolve flag can only be used"),
    ],
)
def test_a_value_without_a_sense_is_refused_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: str, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").touch()
    assert_refused(train(*arguments.split()), message)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_a_run_that_comes_to_the_end_of_memory_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def greedy(self: RPG) -> None:
        torch.empty(2**52)

    monkeypatch.setattr(RPG, "update", greedy)
    outcome = train(*FEW, f"run_dir={tmp_path / 'run'}")
    assert outcome.code == 2
    assert re.search(r"error: there is not enough memory: .*; the run so far is in", outcome.err.splitlines()[-1])


def test_true_and_false_may_be_one_and_nothing(tmp_path: Path) -> None:
    assert train(*FEW, "progress=0", "policy.bias=1", f"run_dir={tmp_path / 'run'}").code == 0


@pytest.mark.parametrize("algo", ["snes", "fem"])
def test_the_search_that_is_named_fits(tmp_path: Path, algo: str) -> None:
    diagonal = ["algo.covariance=diagonal"] if algo == "fem" else ["algo.population=4"]
    outcome = train(*FEW, f"algo={algo}", *diagonal, "policy.hidden_size=300", f"run_dir={tmp_path / 'run'}")
    assert outcome.code == 0, outcome.err


def test_a_checkpoint_that_may_not_be_read_is_not_called_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = tmp_path / "run"
    assert train(*FEW, f"run_dir={run}").code == 0

    def denied(self: Path) -> bytes:
        raise PermissionError(13, "Permission denied", os.fspath(self))

    monkeypatch.setattr(Path, "read_bytes", denied)
    assert_refused(train(f"resume={run}"), r"cannot read .*checkpoint\.pt: Permission denied")


# Sweeps


@pytest.mark.parametrize("refused", ["algo.gamma=2,0.9", "env.corridor_length=0,2"])
def test_a_sweep_goes_on_after_a_refused_job_and_tells_in_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: str
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = train("-m", *FEW, refused, "seed=1,2")
    assert outcome.code == 2
    key = re.escape(refused.partition(",")[0])
    lines = [line for line in outcome.err.splitlines() if line.startswith("error: ")]
    assert re.match(rf"error: job 0 \(.*{key}.*seed=1.*\): .* must be ", lines[0])
    assert re.match(rf"error: job 1 \(.*{key}.*seed=2.*\): .* must be ", lines[1])
    assert lines[2:] == ["error: of the sweep, these jobs failed: 0, 1"]
    assert sorted(summary(path.parent)["seed"] for path in tmp_path.rglob("summary.json")) == [1, 2]


def test_a_signal_ends_the_whole_sweep(tmp_path: Path) -> None:
    send = (
        f"import os, signal; os.chdir({str(tmp_path)!r})\nfrom dpsearch.algos import RPG\nplay = RPG.play_batch\n"
        "def interrupted(self, n):\n  os.kill(os.getpid(), signal.SIGTERM)\n  return play(self, n)\n"
        "RPG.play_batch = interrupted"
    )
    process = start("-m", *FEW, "seed=1,2", first=send)
    _, err = process.communicate(timeout=120)
    assert process.returncode == 128 + 15
    assert err.count("to go on: ") == 1
