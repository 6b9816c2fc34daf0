from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

from dpsearch.policies.observations import UnsupportedSpaceError
from dpsearch.policies.spaces import head_for, to_env_actions


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


@pytest.mark.parametrize("bound", [np.finfo(np.float32).max, 1e38, np.inf])
def test_a_box_whose_bounds_are_the_largest_numbers_has_none(bound: float) -> None:
    space = spaces.Box(-bound, bound, (2,), np.float32)
    np.testing.assert_array_equal(to_env_actions(space, np.array([[0.5, -3.0]])), [[0.5, -3.0]])


def test_actions_have_the_shape_of_their_space() -> None:
    space = spaces.Box(-1, 1, (2, 3))
    assert to_env_actions(space, np.zeros((5, 6))).shape == (5, 2, 3)
