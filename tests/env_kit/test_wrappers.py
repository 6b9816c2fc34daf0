from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env

from dpsearch.env_kit import HiddenState, ObserveOnly, PreviousAction, PreviousReward
from dpsearch.envs import TMaze

ID = "dpsearch.envs:dpsearch/TMaze-v0"
EAST = 1


def test_the_hidden_state_is_one_hot() -> None:
    env = HiddenState(TMaze(3))
    assert env.observation_space == spaces.Box(0, 1, (12,), np.float32)
    observation, info = env.reset(seed=0)
    for _ in range(3):
        assert observation.tolist() == np.eye(12)[info["state"]].tolist()
        assert observation.dtype == np.float32
        observation, *_, info = env.step(EAST)


class Drifting(gym.Env[Any, Any]):
    """Sees nothing of a state of two numbers."""

    observation_space = spaces.Box(0, 0, (1,), np.float32)
    action_space = spaces.Discrete(2)
    state_space = spaces.Box(-5, 5, (2,), np.float64)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        return np.zeros(1, np.float32), {"state": np.array([1.0, 2.0])}


def test_a_hidden_state_of_numbers_is_shown_in_float32() -> None:
    env = HiddenState(Drifting())
    assert env.observation_space == spaces.Box(-5, 5, (2,), np.float32)
    observation = env.reset()[0]
    assert observation.tolist() == [1, 2]
    assert observation.dtype == np.float32


def test_an_environment_that_hides_its_state_for_good_is_refused() -> None:
    with pytest.raises(ValueError, match="does not tell its hidden state"):
        HiddenState(gym.make("CartPole-v1"))


def test_the_previous_action_is_appended_one_hot_and_zeros_at_the_start() -> None:
    env = PreviousAction(TMaze(3))
    assert env.observation_space == spaces.Box(0, 1, (7,), np.float32)
    assert env.reset(seed=0)[0][3:].tolist() == [0, 0, 0, 0]
    assert env.step(EAST)[0].tolist() == [1, 0, 1, 0, 1, 0, 0]
    assert env.step(0)[0].tolist() == [1, 0, 1, 1, 0, 0, 0]
    assert env.reset()[0][3:].tolist() == [0, 0, 0, 0]


def test_a_continuous_previous_action_is_appended_as_it_is() -> None:
    env = PreviousAction(gym.make("Pendulum-v1"))
    assert isinstance(env.observation_space, spaces.Box)
    assert env.observation_space.high.tolist() == [1, 1, 8, 2]
    env.reset(seed=0)
    assert env.step(np.array([1.5], np.float32))[0][3] == 1.5


def test_the_previous_reward_is_appended_and_0_at_the_start() -> None:
    env = PreviousReward(TMaze(3))
    assert isinstance(env.observation_space, spaces.Box)
    assert env.observation_space.high.tolist() == [1, 1, 1, np.inf]
    assert env.reset(seed=0)[0][3] == 0
    assert env.step(0)[0].tolist() == [1, 0, 1, np.float32(-0.1)]
    assert env.step(EAST)[0].tolist() == [1, 0, 1, 0]


def test_only_the_components_asked_for_are_seen() -> None:
    bare = gym.make("CartPole-v1")
    env = ObserveOnly(gym.make("CartPole-v1"), indices=[2, 0])
    assert isinstance(env.observation_space, spaces.Box)
    assert isinstance(bare.observation_space, spaces.Box)
    assert (env.observation_space.high == bare.observation_space.high[[2, 0]]).all()
    assert (env.reset(seed=3)[0] == bare.reset(seed=3)[0][[2, 0]]).all()
    assert (env.step(1)[0] == bare.step(1)[0][[2, 0]]).all()


@pytest.mark.parametrize("indices", [[], [4], [-1], [0, 0]])
def test_components_that_do_not_exist_or_repeat_are_refused(indices: list[int]) -> None:
    with pytest.raises(ValueError, match=r"indices must be distinct and in 0 \.\. 3"):
        ObserveOnly(gym.make("CartPole-v1"), indices)


@pytest.mark.parametrize("wrapper", [PreviousAction, PreviousReward, lambda env: ObserveOnly(env, indices=[0])])
def test_observations_that_are_not_flat_are_refused(wrapper: Any) -> None:
    with pytest.raises(ValueError, match="observations must be flat"):
        wrapper(gym.make("FrozenLake-v1"))


def wrapped() -> gym.Env[Any, Any]:
    """All that can be stacked at once: 3 inputs, 4 actions and a reward, of which five numbers are kept."""
    env = PreviousReward(PreviousAction(gym.make(ID, corridor_length=4)))
    return ObserveOnly(env, indices=[0, 1, 2, 4, 7])


def test_wrapped_environments_pass_gymnasiums_checks() -> None:
    for env in (HiddenState(TMaze(3)), wrapped(), PreviousReward(gym.make("CartPole-v1"))):
        with pytest.warns(UserWarning, match="different from the unwrapped version"):
            check_env(env, skip_render_check=True)


def test_a_wrapped_environment_can_be_made_again_from_its_spec() -> None:
    one = wrapped()
    assert one.spec is not None
    two = gym.make(one.spec)
    assert two.observation_space == one.observation_space
    assert (one.reset(seed=5)[0] == two.reset(seed=5)[0]).all()
    for action in (0, 1, 2, 3, 1):
        mine, theirs = one.step(action), two.step(action)
        assert (mine[0] == theirs[0]).all()
        assert mine[1:] == theirs[1:]


def test_wrappers_leave_reward_end_and_info_as_they_are() -> None:
    plain, env = TMaze(4), HiddenState(wrapped())
    plain.reset(seed=1)
    env.reset(seed=1)
    for action in (1, 3, 1, 1, 1, 1, 0):
        assert plain.step(action)[1:] == env.step(action)[1:]
