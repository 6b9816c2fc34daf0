from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from omegaconf import OmegaConf

import dpsearch.evaluate
from dpsearch.config import completed, compose
from dpsearch.envs import POMDP
from dpsearch.envs.pomdp_file import POMDPVector
from dpsearch.pomdp import PomdpFileError
from tests.support.application import metrics, train
from tests.support.pomdp_texts import FILES, HEAD, MOVES, SEEN

ID = "dpsearch.envs:dpsearch/POMDP-v0"
TIGER = FILES / "tiger.POMDP"
LISTEN, OPEN_LEFT, OPEN_RIGHT = range(3)


@pytest.mark.parametrize("render_mode", [None, "ansi"])
@pytest.mark.parametrize("name", ["tiger", "every_form"])
def test_gymnasiums_checks_pass(name: str, render_mode: str | None) -> None:
    check_env(gym.make(ID, path=FILES / f"{name}.POMDP", render_mode=render_mode).unwrapped)


def test_the_file_is_played() -> None:
    env = POMDP(TIGER)
    for seed in range(20):
        observation, info = env.reset(seed=seed)
        assert observation.tolist() == [0, 0]
        tiger = info["state"]
        heard, reward, *_, info = env.step(LISTEN)
        assert sorted(heard.tolist()) == [0, 1]
        assert (reward, info["state"]) == (-1, tiger)
        assert env.step(OPEN_LEFT)[1] == (10 if tiger else -100)
    assert env.path == TIGER


def test_scalar_and_vector_class_agree() -> None:
    path, n = FILES / "every_form.POMDP", 8
    vector = gym.make_vec(ID, num_envs=n, path=path).unwrapped
    assert isinstance(vector, POMDPVector)
    envs = [POMDP(path) for _ in range(n)]
    seen, _ = vector.reset(seed=0)
    for i, env in enumerate(envs):
        np.testing.assert_array_equal(env.reset(seed=i)[0], seen[i])
    over = np.zeros(n, np.bool_)
    for actions in np.random.default_rng(0).integers(3, size=(30, n)):
        seen, rewards, terminated, *_ = vector.step(actions)
        for i in np.flatnonzero(~over).tolist():
            observation, reward, ended, *_ = envs[i].step(actions[i])
            np.testing.assert_array_equal(observation, seen[i])
            assert (reward, ended) == (rewards[i], terminated[i])
        over |= terminated
    assert over.any()


@pytest.mark.parametrize("discount", [0.0, 0.5, 0.95, 0.98, 0.999, 0.99999, 1.0])
def test_an_episode_lasts_until_rewards_count_for_little(discount: float, tmp_path: Path) -> None:
    path = tmp_path / "x.POMDP"
    path.write_text(TIGER.read_text().replace("discount: 0.95", f"discount: {discount}"))
    limit = POMDP(path).max_episode_steps
    assert 100 <= limit <= 10_000
    assert discount**limit <= 0.01 or limit == 10_000
    assert discount ** (limit - 1) > 0.01 or limit == 100


def test_the_limit_of_the_tiger_is_100_steps_and_there_is_no_threshold() -> None:
    for given, limit in ((None, 100), (7, 7)):
        env: gym.Env[Any, Any] = gym.make(ID, path=TIGER, max_episode_steps=given)
        assert env.spec is not None
        assert (env.spec.max_episode_steps, env.spec.reward_threshold) == (limit, None)
        env.reset(seed=0)
        assert [env.step(LISTEN)[3] for _ in range(limit)] == [False] * (limit - 1) + [True]
    with pytest.raises(ValueError, match="max_episode_steps must be at least 1, got 0"):
        POMDP(TIGER, max_episode_steps=0)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    for make in (POMDP, POMDPVector, lambda path: gym.make(ID, path=path)):
        with pytest.raises(PomdpFileError, match=r"none\.POMDP: there is no such file"):
            make(path=tmp_path / "none.POMDP")
    with pytest.raises(ValueError, match="render_mode must be one of ansi, or None, got 'human'"):
        POMDP(TIGER, render_mode="human")


def test_text_tells_what_there_is_to_know() -> None:
    env = POMDP(TIGER, render_mode="ansi", reveal="belief")
    state = ("tiger-left", "tiger-right")[env.reset(seed=0)[1]["state"]]
    assert env.render() == (
        f" state {state}, last reward none yet\n"
        " sees nothing (0 0), last action none, step 0 of 100, return 0.00\n"
        " belief: tiger-left 50.0%; tiger-right 50.0%"
    )
    heard = ("left", "right")[int(env.step(LISTEN)[0][1])]
    likely = "left 85.0%; tiger-right" if heard == "left" else "right 85.0%; tiger-left"
    assert f" state {state}, last reward -1\n sees hear-{heard}" in env.render()
    assert f" belief: tiger-{likely} 15.0%" in env.render()


def test_text_hides_what_it_is_asked_to_hide(tmp_path: Path) -> None:
    env = POMDP(TIGER, render_mode="ansi", reveal="nothing")
    env.reset(seed=0)
    env.step(LISTEN)
    assert "tiger" not in env.render()
    assert len(env.render().splitlines()) == 1
    path = tmp_path / "x.POMDP"
    path.write_text(HEAD.replace("a b c", "3") + "start: 0\n" + MOVES + SEEN + "T : go : 0 0 0 1 R : * : 0 : * : * 2.5")
    env = POMDP(path, render_mode="ansi")
    env.reset(seed=0)
    assert env.render().startswith(" state 0, last reward none yet\n")
    assert env.step(0)[2]
    assert env.render().startswith(" state 2, which ends the episode, last reward 2.5\n")


# The applications


def test_the_discount_factor_is_that_of_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(FILES)
    config = completed(*compose(["env=pomdp", "env.path=tiger.POMDP"]))
    assert (config.env.gamma, config.algo.gamma) == (0.95, 0.95)
    assert config.env.path == str(TIGER)
    assert completed(*compose(["env=pomdp", "env.path=x", "env.gamma=0.5"])).algo.gamma == 0.5


def test_a_run_can_be_resumed_and_played_from_anywhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(FILES)
    few = ("evaluation_episodes=2", "env=pomdp", "env.path=tiger.POMDP")
    run = tmp_path / "run"
    assert train(*few, "total_updates=2", f"run_dir={run}").code == 0
    monkeypatch.chdir(tmp_path)
    outcome = train(f"resume={run}", "total_updates=4")
    assert outcome.code == 0, outcome.err
    config = OmegaConf.load(run / ".hydra" / "config.yaml")
    assert (config.env.gamma, config.env.path) == (0.95, str(TIGER))
    monkeypatch.chdir(FILES)
    assert train(*few, "total_updates=4", f"run_dir={tmp_path / 'other'}").code == 0
    assert metrics(run) == metrics(tmp_path / "other")
    monkeypatch.chdir(tmp_path)
    dpsearch.evaluate.main([str(run), "--episodes", "2"])
    assert "length: mean 100" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (None, r"error: env\.path must be given$"),
        ("none.POMDP", r"none\.POMDP: there is no such file"),
        ("bad.POMDP", r"bad\.POMDP, line 6: unknown state 'd': the states are a, b, c, or numbers from 0 to 2"),
        ("no_discount.POMDP", r"no_discount\.POMDP: discount: is missing"),
        ("impatient.POMDP", r"algo\.gamma must be in \(0, 1\], got 0"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, path: str | None, message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bad.POMDP").write_text(HEAD + "T : go : d identity")
    Path("no_discount.POMDP").write_text(HEAD.partition("\n")[2] + MOVES + SEEN)
    Path("impatient.POMDP").write_text(HEAD.replace("0.9", "0") + MOVES + SEEN)
    outcome = train("env=pomdp", "run_dir=run", *([f"env.path={path}"] if path else []))
    assert (outcome.code, outcome.out, outcome.err.count("\n")) == (2, "", 1)
    assert re.search(message, outcome.err), outcome.err
    assert not Path("run").exists()
