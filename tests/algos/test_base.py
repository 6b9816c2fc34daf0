"""What every algorithm can do, shown with RPG."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

from dpsearch.algos import RPG
from dpsearch.envs.tmaze import TMaze
from dpsearch.files import CheckpointError, read_checkpoint, write_checkpoint
from dpsearch.policies import CORES, PolicyConfig, UnsupportedSpaceError

TMAZE: dict[str, Any] = {"env_kwargs": {"corridor_length": 3}, "policy": PolicyConfig(init_range=0.5)}


def make(**settings: Any) -> RPG:
    return RPG("dpsearch/TMaze-v0", **{**TMAZE, **settings})


def test_a_run_does_not_depend_on_the_number_of_threads() -> None:
    vectors = [make(threads=threads, batch_size=70).learn(total_updates=8).policy.vector() for threads in (1, 2, 3)]
    np.testing.assert_array_equal(vectors[0], vectors[1])
    np.testing.assert_array_equal(vectors[0], vectors[2])


def test_seeds_differ_in_weights_and_in_episodes() -> None:
    one, other = make(seed=1), make(seed=2)
    assert (one.policy.vector() != other.policy.vector()).all()
    assert one.training_key != other.training_key


def test_learning_leaves_torch_its_threads_and_uses_one() -> None:
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        seen: list[int] = []
        make().learn(total_updates=1, callback=lambda *_: seen.append(torch.get_num_threads()))
        assert (seen, torch.get_num_threads()) == ([1], 2)
    finally:
        torch.set_num_threads(before)


def test_learning_stops_at_each_kind_of_limit() -> None:
    assert make().learn(total_updates=3).updates == 3
    assert make().learn(total_episodes=50).episodes == 60  # whole batches of 20
    assert make().learn(total_steps=100).updates >= 1
    assert make().learn(callback=lambda algorithm, _: algorithm.updates < 4).updates == 4


@pytest.mark.parametrize("answer", [False, np.False_, 0])
def test_a_callback_stops_by_anything_false_but_none(answer: object) -> None:
    assert make().learn(total_updates=3, callback=lambda *_: answer).updates == 1
    assert make().learn(total_updates=3, callback=lambda *_: None).updates == 3


def test_learning_goes_on_from_where_it_stopped() -> None:
    once, twice = make(), make()
    once.learn(total_updates=6)
    twice.learn(total_updates=2).learn(total_updates=6)
    np.testing.assert_array_equal(once.policy.vector(), twice.policy.vector())


@pytest.mark.parametrize(
    ("limits", "reason"),
    [
        ({"total_updates": 2}, "total_updates=2 is counted from the beginning of the run, which has come to 2$"),
        ({"total_episodes": 7}, "total_episodes=7 is counted from the beginning of the run, which has come to 40$"),
        ({"total_steps": 1, "total_updates": 9}, "total_steps=1 is counted"),
        ({"until_solved": True}, "the task is solved, and until_solved is True"),
    ],
)
def test_a_call_that_has_nothing_to_do_says_why(limits: dict[str, Any], reason: str) -> None:
    rpg = make().learn(total_updates=2)
    rpg.solved = True
    with pytest.warns(UserWarning, match=rf"learn\(\) has nothing to do: {reason}"):
        rpg.learn(**limits)
    assert rpg.updates == 2


def test_learning_without_an_end_is_refused() -> None:
    with pytest.raises(ValueError, match="total_steps"):
        make().learn()


def test_until_solved_needs_a_threshold() -> None:
    with pytest.raises(ValueError, match="reward_threshold"):
        RPG("Pendulum-v1").learn(until_solved=True)


def test_a_maze_made_by_hand_knows_when_it_is_solved() -> None:
    registered = gym.spec("dpsearch/TMaze-v0").reward_threshold
    assert RPG(TMaze(corridor_length=3)).rollouts.reward_threshold == registered == 3.8


@pytest.mark.parametrize("core", list(CORES))
def test_saved_and_loaded_it_goes_on_bit_for_bit(tmp_path: Path, core: str) -> None:
    policy = PolicyConfig(core=core, init_range=0.5)
    whole, first = (make(policy=policy, optimizer="Adam", learning_rate=0.01) for _ in range(2))
    whole.learn(total_updates=9)
    first.learn(total_updates=4).save(tmp_path / "rpg.pt")
    second = RPG.load(tmp_path / "rpg.pt").learn(total_updates=9)
    np.testing.assert_array_equal(whole.policy.vector(), second.policy.vector())
    assert (whole.env_steps, whole.episodes) == (second.env_steps, second.episodes)


def test_a_factory_gets_the_saved_arguments_again(tmp_path: Path) -> None:
    RPG(TMaze, env_kwargs={"corridor_length": 3}).save(tmp_path / "rpg.pt")
    assert RPG.load(tmp_path / "rpg.pt", TMaze).env_kwargs == {"corridor_length": 3}


def test_another_environment_does_not_take_the_weights(tmp_path: Path) -> None:
    make().save(tmp_path / "rpg.pt")
    with pytest.raises(CheckpointError, match="does not fit"):
        RPG.load(tmp_path / "rpg.pt", "CartPole-v1", env_kwargs={})


def test_what_was_given_as_an_object_must_be_given_again(tmp_path: Path) -> None:
    RPG(TMaze(corridor_length=3)).save(tmp_path / "rpg.pt")
    with pytest.raises(CheckpointError, match="env"):
        RPG.load(tmp_path / "rpg.pt")
    assert RPG.load(tmp_path / "rpg.pt", TMaze(corridor_length=3)).updates == 0


@pytest.mark.parametrize("kept", [0, 10, 1000])
def test_a_truncated_checkpoint_is_named(tmp_path: Path, kept: int) -> None:
    path = tmp_path / "rpg.pt"
    make().save(path)
    path.write_bytes(path.read_bytes()[:kept])
    with pytest.raises(CheckpointError, match=r"rpg\.pt is damaged, truncated"):
        RPG.load(path)


def test_a_checkpoint_of_something_else_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CheckpointError, match="no checkpoint"):
        read_checkpoint(tmp_path / "missing.pt")
    write_checkpoint(tmp_path / "other.pt", {"algo": "nes"})
    with pytest.raises(CheckpointError, match="'nes'"):
        RPG.load(tmp_path / "other.pt")


def test_a_failed_write_leaves_the_old_checkpoint(tmp_path: Path) -> None:
    path = tmp_path / "rpg.pt"
    write_checkpoint(path, {"algo": "rpg"})
    with pytest.raises(CheckpointError, match="which a checkpoint cannot hold"):
        write_checkpoint(path, {"algo": lambda: None})
    assert read_checkpoint(path)["algo"] == "rpg"


def test_predict_remembers_and_forgets_where_an_episode_begins() -> None:
    rpg = make()
    env = TMaze(corridor_length=3)
    observation, _ = env.reset(seed=0)
    action, memory = rpg.predict(observation, deterministic=True)
    assert action in env.action_space
    _, after = rpg.predict(observation, memory, deterministic=True)
    assert not np.array_equal(memory, after)
    _, fresh = rpg.predict(observation, after, episode_start=True, deterministic=True)
    np.testing.assert_array_equal(fresh, memory)


def test_predict_takes_several_environments_at_once() -> None:
    rpg = make()
    envs = gym.make_vec("dpsearch.envs:dpsearch/TMaze-v0", num_envs=3, corridor_length=3)
    observations, _ = envs.reset(seed=0)
    actions, memory = rpg.predict(observations)
    assert actions.shape == (3,)
    _, one_new = rpg.predict(observations, memory, episode_start=np.array([False, True, False]))
    _, none_new = rpg.predict(observations, memory)
    assert (one_new[1] != none_new[1]).any()
    np.testing.assert_array_equal(one_new[[0, 2]], none_new[[0, 2]])


def test_predict_takes_an_observation_of_another_precision_or_beyond_the_bounds() -> None:
    action, memory = RPG("Pendulum-v1").predict(np.array([1.0, 0.0, 9.0]))
    assert (action.shape, memory.shape[0]) == ((1,), 1)


def test_predicted_actions_are_in_the_units_of_the_environment() -> None:
    rpg = RPG("Pendulum-v1", policy=PolicyConfig(init_range=3.0))
    env = gym.make("Pendulum-v1")
    observation, _ = env.reset(seed=0)
    for _ in range(20):
        action, _ = rpg.predict(observation)
        assert action in env.action_space


def test_evaluation_leaves_training_as_it_was() -> None:
    quiet, watched = make(), make()
    quiet.learn(total_updates=5)
    watched.learn(total_updates=5, callback=lambda algorithm, _: bool(algorithm.evaluate(10).mean_return) or None)
    np.testing.assert_array_equal(quiet.policy.vector(), watched.policy.vector())


def test_every_update_is_evaluated_on_other_episodes() -> None:
    rpg = make(learning_rate=1e-9)
    first, again = rpg.evaluate(200).returns, rpg.evaluate(200).returns
    rpg.update()
    np.testing.assert_array_equal(first, again)
    assert (first != rpg.evaluate(200).returns).any()


def test_fresh_episodes_decide_whether_it_is_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    rpg = make()
    rpg.learn(total_episodes=100)
    assert not rpg.check_solved()  # it is far from it
    rpg.recent_returns.extend([4.0] * 100)
    assert not rpg.check_solved()  # by luck in training, say
    rpg.rollouts.reward_threshold = -1000.0
    assert rpg.check_solved()


def test_evaluation_tells_mean_and_standard_error() -> None:
    evaluation = make().evaluate(50)
    assert evaluation.mean_return == pytest.approx(evaluation.returns.mean())
    assert evaluation.standard_error == pytest.approx(evaluation.returns.std(ddof=1) / np.sqrt(50))
    assert np.isnan(make().evaluate(1).standard_error)


def test_unsupported_spaces_are_refused_before_any_work() -> None:
    class Odd(gym.Env[Any, Any]):
        observation_space = gym.spaces.Sequence(gym.spaces.Discrete(5))
        action_space = gym.spaces.Discrete(2)

    with pytest.raises(UnsupportedSpaceError, match="Sequence"):
        RPG(Odd)


@pytest.mark.parametrize("env", ["Nowhere-v0", "dpsearch/Nowhere-v0", "no_such_module:Env-v0"])
def test_an_unknown_environment_is_named(env: str) -> None:
    with pytest.raises(ValueError, match=r"Nowhere|no_such_module"):
        RPG(env)
