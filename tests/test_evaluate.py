import re
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pytest
from PIL import Image

import dpsearch.evaluate
from dpsearch.algos import RPG
from dpsearch.envs import TMaze
from dpsearch.policies import PolicyConfig, PolicyRunner
from dpsearch.runs import EnvRecipe, load_policy, save_policy
from dpsearch.runs.playback import play_episode
from tests.support.application import train


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp("runs") / "run"
    assert train("env.corridor_length=2", "seed=1", "total_steps=200000", f"run_dir={run}").code == 0
    return run


@dataclass(frozen=True)
class Result:
    code: int
    out: str
    err: str


class Evaluate(Protocol):
    def __call__(self, *arguments: object, path: Path | None = None) -> Result: ...


@pytest.fixture
def evaluate(run: Path, capsys: pytest.CaptureFixture[str]) -> Evaluate:
    """`dpsearch-evaluate RUN ARGUMENTS`, without a new process."""

    def call(*arguments: object, path: Path | None = None) -> Result:
        code: Any = 0
        try:
            dpsearch.evaluate.main([str(argument) for argument in (path or run, *arguments)])
        except SystemExit as exit_:
            code = exit_.code
        captured = capsys.readouterr()
        return Result(code, captured.out, captured.err)

    return call


def assert_refused(result: Result, message: str) -> None:
    assert result.code == 2
    assert result.err.count("\n") == 1
    assert re.search(message, result.err), result.err


class OldMaze(TMaze):
    """A maze that is drawn as environments were before Gymnasium."""

    def __init__(self, drawn: Any, metadata: dict[str, Any]) -> None:
        super().__init__(corridor_length=2)
        self.drawn, self.metadata = drawn, metadata

    def render(self) -> Any:
        return self.drawn


def test_it_says_what_the_policy_achieves(evaluate: Evaluate) -> None:
    result = evaluate("--episodes", 50)
    assert result.code == 0
    assert re.search(r"^50 episodes of the stochastic policy$", result.out, re.M)
    assert re.search(r"^return: mean [\d.]+ ± [\d.]+, median [\d.]+, from \S+ to 4$", result.out, re.M)
    assert re.search(r"^length: mean [\d.]+, median [\d.]+, from 3 to \d+$", result.out, re.M)


def test_the_same_seed_gives_the_same_episodes_and_another_seed_others(evaluate: Evaluate) -> None:
    first = evaluate("--seed", 1)
    assert evaluate("--seed", 1) == first
    assert evaluate("--seed", 2) != first
    assert evaluate("--seed", 1, "--greedy") != first


def test_the_policy_file_alone_is_enough(evaluate: Evaluate, run: Path, tmp_path: Path) -> None:
    shutil.copy(run / "policy.pt", tmp_path / "kept.pt")
    assert evaluate(path=tmp_path / "kept.pt") == evaluate()


def test_a_gif_shows_every_step_and_lingers_at_the_end(evaluate: Evaluate, tmp_path: Path) -> None:
    result = evaluate("--gif", tmp_path / "policy.gif", "--episodes", 2, "--greedy")
    assert result.code == 0, result.err
    assert f"written to {tmp_path / 'policy.gif'}" in result.out
    lengths = [int(length) for length in re.findall(r"episode \d: return \S+, (\d+) steps", result.out)]
    with Image.open(tmp_path / "policy.gif") as gif:
        assert gif.size == (960, 540)
        durations = []
        for frame in range(gif.n_frames):  # type: ignore[attr-defined]
            gif.seek(frame)
            durations.append(gif.info["duration"])
    assert len(lengths) == 2
    assert sum(durations) == 250 * (sum(lengths) + 2) + 2 * 1000  # the T-maze is drawn four times a second
    assert max(durations) == 1250


def test_a_film_of_a_long_episode_shows_its_beginning(evaluate: Evaluate, tmp_path: Path) -> None:
    film = tmp_path / "policy.gif"
    result = evaluate("--gif", film, "--episodes", 1, "--steps", 1)
    assert "1 steps, not shown further (--steps)" in result.out
    assert_refused(evaluate("--steps", 5), "--steps is for watching")


def test_a_video_can_be_made(evaluate: Evaluate, tmp_path: Path) -> None:
    pytest.importorskip("imageio_ffmpeg")
    result = evaluate("--video", tmp_path / "policy.mp4", "--episodes", 1)
    assert result.code == 0, result.err
    assert (tmp_path / "policy.mp4").read_bytes()[4:8] == b"ftyp"


def test_a_window_can_be_watched(evaluate: Evaluate, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr("dpsearch.envs.TMaze.metadata", {"render_modes": ["human"], "render_fps": 1000})
    assert evaluate("--render", "--episodes", 1, "--greedy").code == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--gif", "{folder}/missing/policy.gif"), "cannot write .*: No such file or directory"),
        (("--gif", "{folder}"), "cannot write .*: Is a directory"),
        (("--video", "{folder}"), "cannot write|no video format"),
        (("--video", "{folder}/missing/policy.mp4"), "cannot write"),
        (("--video", "{folder}/policy.bogus"), "no video format for"),
    ],
)
def test_a_film_that_cannot_be_written_is_refused(
    evaluate: Evaluate, tmp_path: Path, arguments: tuple[str, str], message: str
) -> None:
    pytest.importorskip("imageio_ffmpeg")
    assert_refused(evaluate(*(argument.format(folder=tmp_path) for argument in arguments)), message)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("module", "option", "message"),
    [
        ("imageio_ffmpeg", "--video", r'pip install "dpsearch\[video\]"'),
        ("pygame", "--render", r'pip install "dpsearch\[render\]"'),
    ],
)
def test_what_is_not_installed_is_named_with_the_command_that_installs_it(
    evaluate: Evaluate, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, option: str, message: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    film = [tmp_path / "policy.mp4"] if option == "--video" else []
    assert_refused(evaluate(option, *film), message)


def test_an_environment_that_has_no_picture_is_refused(
    evaluate: Evaluate, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("dpsearch.envs.TMaze.metadata", {"render_modes": ["ansi"], "render_fps": 4})
    assert_refused(evaluate("--gif", tmp_path / "policy.gif"), "cannot be drawn")


OLD = {"render.modes": ["rgb_array"], "render_fps": 4}


@pytest.mark.parametrize("metadata", [OLD, {**OLD, "render_modes": []}])
def test_an_environment_with_metadata_of_old_is_drawn(
    evaluate: Evaluate, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, metadata: dict[str, Any]
) -> None:
    drawn = np.zeros((8, 8, 3), np.uint8)
    monkeypatch.setattr("dpsearch.envs.TMaze.metadata", metadata)
    monkeypatch.setattr("dpsearch.evaluate.EnvRecipe.make", lambda self, mode=None: OldMaze(drawn, metadata))
    result = evaluate("--gif", tmp_path / "policy.gif", "--episodes", 1, "--steps", 2)
    assert result.code == 0, result.err


@pytest.mark.filterwarnings("ignore:.*The environment creator metadata")
@pytest.mark.parametrize("metadata", [{"render_fps": 4}, {"render_fps": 4, "render_modes": None}])
def test_an_environment_whose_metadata_names_no_mode_is_refused(
    evaluate: Evaluate, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, metadata: dict[str, Any]
) -> None:
    monkeypatch.setattr("dpsearch.envs.TMaze.metadata", metadata)
    assert_refused(evaluate("--gif", tmp_path / "policy.gif"), "cannot be drawn")


def test_where_there_is_no_policy_it_says_so(evaluate: Evaluate, tmp_path: Path) -> None:
    assert_refused(evaluate(path=tmp_path), "no checkpoint at .*policy.pt")
    assert_refused(evaluate(path=tmp_path / "missing"), "no checkpoint at .*missing")


def test_a_truncated_policy_is_refused(evaluate: Evaluate, run: Path, tmp_path: Path) -> None:
    (tmp_path / "policy.pt").write_bytes((run / "policy.pt").read_bytes()[:1000])
    assert_refused(evaluate(path=tmp_path), "policy.pt is damaged, truncated or not a checkpoint")


def test_a_checkpoint_in_the_place_of_a_policy_is_refused(evaluate: Evaluate, run: Path) -> None:
    assert_refused(evaluate(path=run / "checkpoint.pt"), "checkpoint.pt is a checkpoint: give policy.pt or the run")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--episodes", 0), "--episodes: must be at least 1, got 0"),
        (("--episodes", "many"), "--episodes: must be a whole number, got 'many'"),
        (("--seed", -1), "--seed: must be in"),
    ],
)
def test_a_wrong_option_is_refused(evaluate: Evaluate, arguments: tuple[object, ...], message: str) -> None:
    result = evaluate(*arguments)
    assert result.code == 2
    assert message in result.err


def test_a_saved_policy_acts_as_before(tmp_path: Path) -> None:
    recipe = EnvRecipe("CartPole-v1", observe_only=[0, 2])
    rpg = RPG(recipe.rollouts(), policy=PolicyConfig(core="elman", hidden_size=3), seed=5)
    save_policy(tmp_path / "policy.pt", rpg, recipe)
    policy, loaded = load_policy(tmp_path / "policy.pt")
    assert loaded == recipe
    assert policy.config() == rpg.policy.config()
    np.testing.assert_array_equal(policy.vector(), rpg.policy.vector())


def test_an_episode_is_played_the_same_whether_it_is_filmed_or_not() -> None:
    class Counter:
        frames_per_second = 3.0
        frames = 0

        def add(self, frame: object) -> None:
            self.frames += 1

        def close(self) -> None: ...

    recipe, film = EnvRecipe("dpsearch.envs:dpsearch/TMaze-v0", {"corridor_length": 2}), Counter()
    policy = RPG(recipe.rollouts()).policy
    filmed = play_episode(recipe.make("rgb_array"), PolicyRunner(policy, seed=4), 3, film)
    assert play_episode(recipe.make(), PolicyRunner(policy, seed=4), 3) == filmed
    assert film.frames == filmed[1] + 1 + 3
