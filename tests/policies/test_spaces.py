from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector.utils import concatenate, create_empty_array

from dpsearch.policies.spaces import (
    UnsupportedSpaceError,
    batch_one,
    flatten_observations,
    head_for,
    observation_size,
    to_env_actions,
)

OBSERVATION_SPACES: list[gym.Space[Any]] = [
    spaces.Box(-1, 1, (2, 3)),
    spaces.Box(0, 255, (2, 2), np.uint8),
    spaces.Discrete(5),
    spaces.Discrete(3, start=-1),
    spaces.MultiDiscrete([2, 3]),
    spaces.MultiDiscrete(np.array([[2, 3], [4, 2]])),
    spaces.MultiBinary(4),
    spaces.Tuple([spaces.Discrete(2), spaces.Box(-1, 1, (2,))]),
    spaces.Dict(
        sight=spaces.Box(-1, 1, (2,)),
        touch=spaces.Dict(left=spaces.Discrete(2), right=spaces.MultiBinary(2)),
    ),
]


@pytest.mark.parametrize("space", OBSERVATION_SPACES, ids=str)
def test_observations_are_flattened_as_gymnasium_does(space: gym.Space[Any]) -> None:
    space.seed(0)
    singles = [space.sample() for _ in range(7)]
    empty: Any = create_empty_array(space, 7)
    flat = flatten_observations(space, concatenate(space, singles, empty))
    assert flat.dtype == np.float32
    assert flat.shape == (7, observation_size(space))
    np.testing.assert_array_equal(flat, [spaces.flatten(space, single) for single in singles])
    np.testing.assert_array_equal(flatten_observations(space, batch_one(space, singles[3])), flat[3:4])


@pytest.mark.parametrize(
    "space",
    [
        spaces.Sequence(spaces.Discrete(2)),
        spaces.Graph(spaces.Box(-1, 1, (2,)), None),
        spaces.Dict(a=spaces.Sequence(spaces.Discrete(2))),
        spaces.Box(-1, 1, (0,)),
    ],
    ids=str,
)
def test_an_observation_space_without_a_fixed_length_is_refused_in_one_line(space: gym.Space[Any]) -> None:
    with pytest.raises(UnsupportedSpaceError, match=r"^observation space .* is not supported: .*$"):
        observation_size(space)


@pytest.mark.parametrize(
    "space",
    [
        spaces.MultiBinary(3),
        spaces.Tuple([spaces.Discrete(2), spaces.Discrete(2)]),
        spaces.MultiDiscrete(np.array([[2, 2], [2, 2]])),
        spaces.Box(0, 9, (2,), np.int64),
        spaces.Box(-1, 1, ()),
    ],
    ids=str,
)
def test_an_action_space_without_a_head_is_refused_in_one_line(space: gym.Space[Any]) -> None:
    with pytest.raises(UnsupportedSpaceError, match=r"^action space .* is not supported: .*$"):
        head_for(space)


def test_discrete_actions_count_from_where_the_space_does() -> None:
    actions = np.array([[0.0], [2.0]])
    assert to_env_actions(spaces.Discrete(3), actions).tolist() == [0, 2]
    assert to_env_actions(spaces.Discrete(3, start=-1), actions).tolist() == [-1, 1]
    several = spaces.MultiDiscrete([3, 2], start=[5, 0])
    assert to_env_actions(several, np.array([[2.0, 1.0]])).tolist() == [[7, 1]]


def test_a_bounded_box_is_reached_from_minus_one_to_one_and_clipped() -> None:
    space = spaces.Box(np.array([0.0, -2.0], np.float32), np.array([10.0, 2.0], np.float32))
    actions = np.array([[-1.0, -1.0], [0.0, 0.0], [1.0, 1.0], [3.0, -3.0], [0.5, -0.5]])
    expected = np.array([[0, -2], [5, 0], [10, 2], [10, -2], [7.5, -1]])
    converted = to_env_actions(space, actions)
    assert converted.dtype == np.float32
    np.testing.assert_allclose(converted, expected)
    assert all(space.contains(action) for action in converted)


def test_an_unbounded_box_takes_the_numbers_as_they_are() -> None:
    space = spaces.Box(np.array([-np.inf, 0.0], np.float32), np.array([np.inf, np.inf], np.float32))
    np.testing.assert_array_equal(to_env_actions(space, np.array([[7.0, 3.0], [-7.0, -3.0]])), [[7, 3], [-7, 0]])


def test_actions_have_the_shape_of_their_space() -> None:
    space = spaces.Box(-1, 1, (2, 3))
    assert to_env_actions(space, np.zeros((5, 6))).shape == (5, 2, 3)
