from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import ClipReward, TimeLimit

from dpsearch.envs import TMaze
from dpsearch.policies import PolicyConfig, RecurrentPolicy
from dpsearch.rollout import GymEngine, LaneEngine, Rollouts, make_rollouts
from tests.support.toy_envs import Countdown

TMAZE = "dpsearch/TMaze-v0"


def returns(rollouts: Rollouts) -> list[float]:
    policy = RecurrentPolicy.for_spaces(rollouts.observation_space, rollouts.action_space, PolicyConfig(init_range=0.5))
    try:
        return [float(total) for total in rollouts.collect(policy, 12, key=9).returns]
    finally:
        rollouts.close()


@pytest.mark.parametrize(
    "env",
    [
        TMAZE,
        f"dpsearch.envs:{TMAZE}",
        TMaze,
        TMaze(),
        gym.make(f"dpsearch.envs:{TMAZE}"),
        gym.make_vec(f"dpsearch.envs:{TMAZE}", num_envs=3),
        partial(gym.make, f"dpsearch.envs:{TMAZE}"),
    ],
    ids=["id", "id with module", "class", "instance", "wrapped instance", "vector", "factory"],
)
def test_an_environment_with_a_kernel_is_played_in_lanes_however_it_comes(env: Any) -> None:
    rollouts = make_rollouts(env)
    assert isinstance(rollouts, LaneEngine)
    assert rollouts.max_steps == 1000
    assert rollouts.observation_space == TMaze().observation_space
    assert rollouts.action_space == TMaze().action_space
    assert returns(rollouts) == returns(make_rollouts(TMaze()))


def test_the_solved_threshold_is_the_registered_one() -> None:
    assert make_rollouts(TMAZE).reward_threshold == gym.spec(TMAZE).reward_threshold
    assert make_rollouts("CartPole-v1").reward_threshold == 475.0
    assert make_rollouts(TMaze()).reward_threshold == 3.8


def test_arguments_reach_the_environment() -> None:
    for env in (TMAZE, TMaze):
        rollouts = make_rollouts(env, env_kwargs={"corridor_length": 200, "encoding": "one_hot"})
        assert rollouts.max_steps == 2010
        assert rollouts.observation_size == 4


@pytest.mark.parametrize("env", [TMAZE, TMaze, TMaze(), TimeLimit(TMaze(), 30)])
def test_the_smallest_step_limit_holds(env: Any) -> None:
    assert make_rollouts(env, max_episode_steps=20).max_steps == 20
    assert make_rollouts(env, max_episode_steps=5000).max_steps == (30 if isinstance(env, TimeLimit) else 1000)


@pytest.mark.parametrize("env", [ClipReward(TMaze(), 0, 1), lambda: ClipReward(TMaze(), 0, 1)])
def test_a_wrapper_that_changes_something_is_not_passed_over(env: Any) -> None:
    rollouts = make_rollouts(env)
    assert isinstance(rollouts, GymEngine)
    assert rollouts.max_steps == 1000
    assert set(returns(rollouts)) <= {0.0, 1.0}


def test_an_environment_without_a_kernel_is_played_by_the_vector_engine() -> None:
    rollouts = make_rollouts("CartPole-v1", num_envs=3)
    assert isinstance(rollouts, GymEngine)
    assert rollouts.max_steps == 500
    assert returns(rollouts) == returns(make_rollouts(partial(gym.make, "CartPole-v1")))
    assert make_rollouts("CartPole-v1", max_episode_steps=7).max_steps == 7


def test_a_probe_is_closed_but_what_came_ready_is_not() -> None:
    made: list[Countdown] = []

    def make() -> Countdown:
        made.append(Countdown())
        return made[-1]

    rollouts = make_rollouts(make, max_episode_steps=5)
    rollouts.close()
    assert [env.closed for env in made] == [True, True]
    ready = Countdown()
    make_rollouts(ready, max_episode_steps=5).close()
    assert not ready.closed


@pytest.mark.parametrize("env_id", ["CartPol-v1", "CartPole-v9", "dpsearch/Nope-v0", "no_such_module:Env-v0", "Nope"])
def test_an_unknown_id_is_refused_in_one_line(env_id: str) -> None:
    with pytest.raises(ValueError, match=rf"^cannot make environment '{env_id}': .+$"):
        make_rollouts(env_id)


def test_what_an_environment_says_of_its_arguments_comes_through() -> None:
    with pytest.raises(ValueError, match="corridor_length"):
        make_rollouts(TMAZE, env_kwargs={"corridor_length": 0})
    with pytest.raises(TypeError, match="unexpected keyword"):
        make_rollouts(TMAZE, env_kwargs={"corridor": 10})


def test_an_environment_without_a_step_limit_gets_one_with_a_warning() -> None:
    with pytest.warns(UserWarning, match="max_episode_steps is taken to be 1000"):
        assert make_rollouts(Countdown).max_steps == 1000


def test_a_setting_of_the_other_engine_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^num_envs must be null, got 4: "):
        make_rollouts(TMAZE, num_envs=4)
    with pytest.raises(ValueError, match=r"^threads must be 1, got 2: "):
        make_rollouts(Countdown, threads=2, max_episode_steps=9)


def test_arguments_of_a_ready_environment_are_refused() -> None:
    with pytest.raises(ValueError, match="give a factory"):
        make_rollouts(TMaze(), env_kwargs={"corridor_length": 5})


def test_threads_are_those_of_the_lane_engine() -> None:
    rollouts = make_rollouts(TMAZE, threads=2)
    assert isinstance(rollouts, LaneEngine)
    assert rollouts.threads == 2
    assert np.array_equal(returns(rollouts), returns(make_rollouts(TMAZE)))


def test_what_counts_as_solved_follows_a_limit_given_from_outside() -> None:
    assert make_rollouts("dpsearch/DoublePole-v0").reward_threshold == 100_000
    assert make_rollouts("dpsearch/DoublePole-v0", max_episode_steps=500).reward_threshold == 500
    failure = make_rollouts("dpsearch/DoublePole-v0", max_episode_steps=500, env_kwargs={"reward": "failure"})
    assert failure.reward_threshold == 0
