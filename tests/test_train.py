import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from omegaconf import OmegaConf

from dpsearch.runs import RunDirectory
from tests.support.application import ROOT, Outcome, metrics, start, summary, train

# A run that takes about a tenth of a second, and goes on after it would be solved
SMALL = ("env.corridor_length=3", "until_solved=false", "total_updates=60", "evaluation_episodes=10")

# Checkpoints at every update from here on, which a run is killed between
EAGER = "import dpsearch.runs.run; dpsearch.runs.run.LOOK_SECONDS = 0"
KILL = "import os, signal; os.kill(os.getpid(), signal.SIGKILL)"


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("runs") / "uninterrupted"
    outcome = train(*SMALL, f"run_dir={run}")
    assert outcome.code == 0, outcome.err
    return run


@pytest.fixture
def copy(uninterrupted: Path, tmp_path: Path) -> Path:
    """The finished run, to be spoiled."""
    shutil.copytree(uninterrupted, tmp_path / "copy")
    return tmp_path / "copy"


def assert_same_run(run: Path, other: Path) -> None:
    assert metrics(run) == metrics(other)
    assert summary(run) == summary(other)


def assert_refused(outcome: Outcome, message: str) -> None:
    assert outcome.code == 2
    assert outcome.out == ""
    assert outcome.err.count("\n") == 1
    assert re.search(message, outcome.err), outcome.err


# What a run leaves behind


def test_a_run_leaves_what_is_needed_to_understand_and_to_use_it(uninterrupted: Path) -> None:
    names = {path.relative_to(uninterrupted).as_posix() for path in uninterrupted.rglob("*") if path.is_file()}
    (events,) = (name for name in names if name.startswith("events.out.tfevents."))
    assert names - {events} == {
        ".hydra/config.yaml",
        ".hydra/hydra.yaml",
        ".hydra/overrides.yaml",
        "checkpoint.pt",
        "metrics.jsonl",
        "policy.pt",
        "summary.json",
    }


def test_metrics_have_one_line_for_each_update(uninterrupted: Path) -> None:
    rows = metrics(uninterrupted)
    assert [row["update"] for row in rows] == list(range(1, 61))
    assert [row["episodes"] for row in rows] == list(range(20, 1201, 20))
    assert {"env_steps", "return", "recent_return", "episode_length", "gradient_norm", "entropy"} <= set(rows[0])


def test_the_summary_says_what_was_run_and_what_came_out(uninterrupted: Path) -> None:
    content = json.loads((uninterrupted / "summary.json").read_text())
    last = metrics(uninterrupted)[-1]
    assert content["algo"] == "rpg"
    assert content["env"] == "dpsearch.envs:dpsearch/TMaze-v0"
    kwargs = {"corridor_length": 3, "encoding": "bits", "max_episode_steps": None, "wrong_turn_reward": -0.1}
    assert content["env_kwargs"] == kwargs
    assert (content["seed"], content["updates"], content["episodes"]) == (0, 60, 1200)
    assert content["env_steps"] == last["env_steps"]
    assert content["solved"] == (content["return_stochastic"] >= 3.8)
    assert content["wall_time_s"] > 0
    assert {"return_greedy", "return_greedy_se", "return_stochastic_se", "evaluations"} <= set(content)
    assert set(content["versions"]) == {"python", "dpsearch", "torch", "numpy", "gymnasium", "numba"}


@pytest.mark.parametrize("name", ["checkpoint.pt", "policy.pt"])
def test_files_of_a_run_are_read_without_executing_anything(uninterrupted: Path, name: str) -> None:
    assert torch.load(uninterrupted / name, weights_only=True)["versions"]


def test_the_run_ends_by_saying_what_the_policy_achieves_and_how_to_watch_it(copy: Path) -> None:
    outcome = train(f"resume={copy}")
    assert outcome.code == 0
    assert re.search(r"60 updates, 1,200 episodes, [\d,]+ environment steps in [\d.]+ s", outcome.out)
    assert re.search(r"mean return of 10 episodes: .+ ± .+ stochastic, .+ ± .+ greedy, not solved", outcome.out)
    assert f"dpsearch-evaluate {copy} --render" in outcome.out
    assert f"tensorboard --logdir {copy}" in outcome.out


def test_a_run_stops_when_it_is_solved(tmp_path: Path) -> None:
    outcome = train("env.corridor_length=1", "env.reward_threshold=3.5", f"run_dir={tmp_path / 'run'}")
    assert outcome.code == 0
    assert "solved (threshold 3.5)" in outcome.out
    content = summary(tmp_path / "run")
    assert content["solved"] is True
    assert content["env_steps"] < 1_000_000


def test_runs_without_a_directory_of_their_own_are_sorted_by_algorithm_and_environment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    few = ("total_updates=1", "evaluation_episodes=2")
    assert train(*few, "seed=7").code == 0
    assert train(*few, "env=gym", "env.id=CartPole-v1").code == 0
    runs = sorted(path.parent.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("summary.json"))
    time_ = r"\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d"
    assert re.fullmatch(rf"runs/rpg/CartPole-v1/{time_}_seed0 runs/rpg/tmaze/{time_}_seed7", " ".join(runs))


def test_several_seeds_can_be_run_by_one_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = train("-m", "seed=0,1", "total_updates=1", "evaluation_episodes=2")
    assert outcome.code == 0
    found = sorted(summary(path.parent)["seed"] for path in tmp_path.rglob("summary.json"))
    assert found == [0, 1]


def test_a_sweep_into_one_directory_is_refused_before_it_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = train("-m", "seed=0,1", "run_dir=run", *SMALL)
    assert outcome.code == 2
    assert re.fullmatch("error: run_dir is one directory, and a sweep needs several: .*\n", outcome.err)
    assert not (tmp_path / "run").exists()
    assert train("-m", "seed=0,1", "run_dir=run${seed}", "total_updates=1", "evaluation_episodes=2").code == 0
    assert summary(tmp_path / "run1")["seed"] == 1


# The same run, however it is run


def test_a_run_does_not_depend_on_the_number_of_threads(uninterrupted: Path, tmp_path: Path) -> None:
    assert train(*SMALL, f"run_dir={tmp_path / 'run'}", "rollout.threads=2").code == 0
    assert_same_run(tmp_path / "run", uninterrupted)


def test_a_run_does_not_depend_on_how_often_it_is_saved(
    uninterrupted: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dpsearch.runs.run.LOOK_SECONDS", 0)
    assert train(*SMALL, f"run_dir={tmp_path / 'run'}", "checkpoint_seconds=1e-9").code == 0
    assert_same_run(tmp_path / "run", uninterrupted)


def test_another_seed_is_another_run(uninterrupted: Path, tmp_path: Path) -> None:
    assert train(*SMALL, f"run_dir={tmp_path / 'run'}", "seed=1").code == 0
    assert metrics(tmp_path / "run")[0]["return"] != metrics(uninterrupted)[0]["return"]


@pytest.mark.parametrize(
    "sabotage",
    [
        pytest.param(
            f"import dpsearch.runs.run as r\ndef die(*_): {KILL}\nr.Run.checkpoint = die",
            id="before the first checkpoint",
        ),
        pytest.param(
            "from dpsearch.algos import RPG\nplay = RPG.play_batch\n"
            f"def die(self, n):\n  if self.updates == 23: {KILL}\n  return play(self, n)\nRPG.play_batch = die",
            id="within an update, long after the checkpoint",
        ),
        pytest.param(
            "import dpsearch.runs.metrics as m\nadd = m.MetricsFile.add\n"
            "def die(self, row):\n  if row['update'] == 31:\n"
            f"    self._file.write(b'{{\"update\": 3'); self._file.flush(); {KILL}\n  add(self, row)\n"
            f"m.MetricsFile.add = die\n{EAGER}",
            id="within a line of the metrics",
        ),
        pytest.param(
            "import dpsearch.files as c\nreplace, calls = c.os.replace, []\n"
            f"def die(*a):\n  calls.append(a)\n  if len(calls) == 19: {KILL}\n  replace(*a)\n"
            f"c.os.replace = die\n{EAGER}",
            id="while a checkpoint is written",
        ),
        pytest.param(f"from dpsearch.runs import Run\ndef die(*_): {KILL}\nRun.finish = die", id="at the end"),
    ],
)
def test_a_run_that_was_killed_goes_on_as_if_nothing_had_happened(
    uninterrupted: Path, tmp_path: Path, sabotage: str
) -> None:
    run = tmp_path / "run"
    process = start(*SMALL, f"run_dir={run}", "checkpoint_seconds=1e-9", first=sabotage)
    _, err = process.communicate(timeout=60)
    assert process.returncode == -signal.SIGKILL, err
    assert not (run / "summary.json").exists()
    outcome = train(f"resume={run}")
    assert outcome.code == 0, outcome.err
    assert_same_run(run, uninterrupted)


def test_a_finished_run_can_be_made_longer(uninterrupted: Path, copy: Path, tmp_path: Path) -> None:
    assert train(f"resume={copy}", "total_updates=70", "rollout.threads=2", "progress=false").code == 0
    assert train(*SMALL, "total_updates=70", f"run_dir={tmp_path / 'long'}").code == 0
    assert_same_run(copy, tmp_path / "long")
    config = OmegaConf.load(copy / ".hydra" / "config.yaml")
    assert (config.total_updates, config.rollout.threads, config.env.corridor_length) == (70, 2, 3)
    assert config.resume is None


# What is refused, in one line


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("bogus=1", "error: bogus is not a setting: there are .*seed"),
        ("algo.bogus=1", r"error: algo\.bogus is not a setting of algo: there are batch_size, "),
        ("env.corridor_lenght=1", r"error: env\.corridor_lenght is .* of env: did you mean corridor_length\?"),
        ("env.corridor_length=long", r"error: env\.corridor_length.*'long'.*Integer"),
        ("seed=1.5", "seed.*Integer"),
        ("algo=bogus", r"algo/bogus.*: rpg: "),
        ("env=bogus", r"env/bogus.*: gym: .*: track$"),
        ("experiment=bogus", "experiment/bogus"),
        ("env.corridor_length=0", r"error: env\.corridor_length must be .* got 0"),
        ("env.encoding=morse", r"error: env\.encoding must be .* 'morse'"),
        ("env.max_episode_steps=0", r"error: env\.max_episode_steps must be at least 1"),
        ("algo.gamma=2", r"algo\.gamma must be in \(0, 1\], got 2"),
        ("algo.optimizer=Bogus", r"algo\.optimizer must be one of"),
        ("algo.optimizer_options.bogus=1", r"algo\.optimizer_options .*bogus"),
        ("algo.optimizer_options={momentum:foo}", r"algo\.optimizer_options "),
        ("algo.optimizer_options={lr:1}", r"algo\.optimizer_options .*'lr'"),
        ("algo.variance_scaled=true", r"algo\.variance_scaled must be false: it needs a Gaussian policy"),
        ("policy.core=bogus", r"policy\.core must be"),
        ("policy.forget_bias=inf", r"policy\.forget_bias must be finite, got inf"),
        ("env.reward_threshold=nan", r"env\.reward_threshold must be finite, got nan"),
        ("rollout.threads=0", r"rollout\.threads must be at least 1"),
        ("total_steps=0", "total_steps must be at least 1"),
        ("seed=-1", "seed must be in"),
        ("env=track env.width=-1", r"error: env\.width must be a finite number of metres, at least 4, got -1\.0"),
        ("env=track env.speed_profile=[10,70]", r"error: env\.speed_profile must be start and end"),
        ("env=track env.observations=[wheel]", r"error: env\.observations must be some of speed"),
        ("policy.core=rnn", r"policy\.core=rnn is now policy\.core=elman$"),
        (
            "algo.baseline={kind:history,optimizer_options:{momentum:1}}",
            r"algo\.baseline\.optimizer_options do not fit",
        ),
        ("env=gym", r"error: env\.id must be given$"),
        ("env=track env.observations=[rays]", r"algo\.mirror must be false: this environment declares no mirror_signs"),
        ("env=gym env.id=Bogus-v0", "cannot make environment 'Bogus-v0'"),
        ("env=gym env.id=bogus:Bogus-v0", "No module named 'bogus'"),
        ("env=gym env.id=CartPole-v1 env.kwargs.bogus=1", "bogus"),
        ("env=gym env.id=CartPole-v1 env.observe_only=[4]", r"0 \.\. 3"),
        ("env=gym env.id=tests.support.odd_envs:tests/Wordy-v0", "observation space .* is not supported"),
        ("env=gym env.id=Pendulum-v1 total_steps=null", "nothing would end this run"),
        ("until_solved=false total_steps=null", "nothing would end this run"),
    ],
)
def test_a_wrong_value_is_refused_in_one_line_and_leaves_nothing(tmp_path: Path, arguments: str, message: str) -> None:
    assert_refused(train(*arguments.split(), f"run_dir={tmp_path / 'run'}"), message)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("path", ["/proc/run", "{file}/run"])
def test_a_directory_that_cannot_be_written_is_refused(tmp_path: Path, path: str) -> None:
    (tmp_path / "file").touch()
    outcome = train(f"run_dir={path.format(file=tmp_path / 'file')}")
    assert_refused(outcome, "cannot write the run directory")


def test_a_directory_that_holds_a_run_is_left_alone(copy: Path) -> None:
    before = {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()}
    assert_refused(train(*SMALL, f"run_dir={copy}", "seed=1"), "already holds a run")
    assert {path: path.read_bytes() for path in copy.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("size", [0, 100, 3000])
def test_a_truncated_checkpoint_is_refused(copy: Path, size: int) -> None:
    os.truncate(copy / "checkpoint.pt", size)
    assert_refused(train(f"resume={copy}"), "checkpoint.pt is damaged, truncated or not a checkpoint")
    assert len(metrics(copy)) == 60


def test_a_run_whose_checkpoint_is_lost_does_not_begin_anew(copy: Path) -> None:
    (copy / "checkpoint.pt").unlink()
    assert_refused(train(f"resume={copy}"), "no checkpoint")
    assert len(metrics(copy)) == 60


def test_metrics_that_end_before_the_checkpoint_are_refused(copy: Path) -> None:
    os.truncate(copy / "metrics.jsonl", 1000)
    assert_refused(train(f"resume={copy}"), "metrics.jsonl ends at update")


def test_there_is_nothing_to_resume_where_there_is_no_run(tmp_path: Path) -> None:
    assert_refused(train(f"resume={tmp_path}"), "there is no run in")


@pytest.mark.parametrize("override", ["seed=1", "algo.learning_rate=0.1", "env=gym", "run_dir=elsewhere"])
def test_what_a_run_learns_from_cannot_be_changed_when_it_is_resumed(copy: Path, override: str) -> None:
    key = override.partition("=")[0]
    assert_refused(train(f"resume={copy}", override), f"{key} cannot be changed when a run is resumed")


def test_a_run_has_one_process_at_a_time(copy: Path) -> None:
    fcntl = pytest.importorskip("fcntl")
    with open(copy / "metrics.jsonl", "rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert_refused(train(f"resume={copy}"), "another process is at work")


def test_numbers_that_are_not_finite_end_the_run_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def diverge(*_: object) -> None:
        raise FloatingPointError("the gradient is not finite")

    monkeypatch.setattr("dpsearch.algos.RPG.update", diverge)
    outcome = train(*SMALL, f"run_dir={tmp_path / 'run'}")
    assert outcome.code == 2
    assert outcome.err.splitlines()[1:] == [
        f"error: the gradient is not finite; the run so far is in {tmp_path / 'run'}"
    ]


@pytest.mark.parametrize("method", ["write_summary", "write_config"])
def test_a_full_disk_ends_the_run_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: str) -> None:
    def fail(self: RunDirectory, _: object) -> None:
        if self.metrics.exists():
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(RunDirectory, method, fail)
    outcome = train(*SMALL, f"run_dir={tmp_path / 'run'}", "progress=false")
    assert outcome.code == 2
    assert re.search(r"error: .*No space left on device; the run so far is in", outcome.err.splitlines()[-1])


# The command itself


def test_the_command_refuses_in_one_line_too() -> None:
    command = [sys.executable, "train.py", "algo=rpg", "env=tmaze", "env.corridor_length=0"]
    result = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert_refused(Outcome(result.returncode, result.stdout, result.stderr), "corridor_length must be")


def test_an_error_of_the_program_keeps_its_traceback(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise ZeroDivisionError("a mistake")

    monkeypatch.setattr("dpsearch.algos.RPG.update", fail)
    with pytest.raises(ZeroDivisionError, match="a mistake"):
        train(*SMALL, f"run_dir={tmp_path / 'run'}")
