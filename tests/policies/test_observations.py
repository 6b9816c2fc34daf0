from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector.utils import concatenate, create_empty_array

from dpsearch.policies.observations import UnsupportedSpaceError, flattener, observation_size

SPACES: list[gym.Space[Any]] = [
    spaces.Box(-1, 1, (2, 3)),
    spaces.Box(-1, 1, (1,)),
    spaces.Box(0, 255, (2, 2), np.uint8),
    spaces.Discrete(5),
    spaces.Discrete(3, start=-1),
    spaces.MultiDiscrete([2, 3]),
    spaces.MultiDiscrete([2, 3], start=[1, -4]),
    spaces.MultiDiscrete(np.array([[2, 3], [4, 2]])),
    spaces.MultiBinary(4),
    spaces.MultiBinary((2, 2)),
    spaces.Tuple([spaces.Discrete(2), spaces.Box(-1, 1, (2,))]),
    spaces.Dict(
        sight=spaces.Box(-1, 1, (2,)),
        touch=spaces.Dict(left=spaces.Discrete(2), right=spaces.MultiBinary(2)),
    ),
]


class Words(gym.Space[str]):
    """A space of one's own, which has no flat form."""


def several(space: gym.Space[Any], count: int) -> tuple[list[Any], Any]:
    """Samples of a space, and the same as a batch."""
    space.seed(0)
    singles = [space.sample() for _ in range(count)]
    empty: Any = create_empty_array(space, count)
    return singles, concatenate(space, singles, empty)


@pytest.mark.parametrize("space", SPACES, ids=str)
def test_observations_are_flattened_as_gymnasium_does(space: gym.Space[Any]) -> None:
    flatten = flattener(space)
    singles, batch = several(space, 7)
    flat = flatten.batch(batch)
    assert flat.dtype == np.float32
    assert flat.shape == (7, flatten.size) == (7, observation_size(space))
    np.testing.assert_array_equal(flat, [spaces.flatten(space, single) for single in singles])
    np.testing.assert_array_equal([flatten.one(single) for single in singles], flat)


@pytest.mark.parametrize("space", SPACES, ids=str)
@pytest.mark.parametrize("count", [1, 3])
def test_one_observation_is_told_from_a_batch(space: gym.Space[Any], count: int) -> None:
    singles, batch = several(space, count)
    assert flattener(space).is_one(singles[0]) is True
    discrete_only = isinstance(space, spaces.Discrete) and count == 1
    assert flattener(space).is_one(batch) is (None if discrete_only else False)


@pytest.mark.parametrize("change", [lambda x: x.astype(np.float64), lambda x: x + 1e-6, lambda x: 100.0 * x])
def test_values_beyond_the_bounds_or_of_another_precision_are_taken_as_they_are(change: Any) -> None:
    space = spaces.Dict(sight=spaces.Box(-1, 1, (2,)), turn=spaces.Discrete(3))
    values = change(np.array([1.0, -1.0], np.float32))
    flatten = flattener(space)
    observation = {"sight": values, "turn": np.array([2])}
    assert flatten.is_one(observation) is True
    np.testing.assert_array_equal(flatten.one(observation), np.array([*values, 0, 0, 1], np.float32))


def test_an_image_may_hold_floats() -> None:
    """Many wrappers scale images and leave the space as it was."""
    flat = flattener(spaces.Box(0, 255, (2,), np.uint8)).one(np.array([0.25, 0.75]))
    assert flat.tolist() == [0.25, 0.75]


@pytest.mark.parametrize(
    ("space", "observation"),
    [
        (spaces.Box(-1, 1, (2,)), np.zeros(1)),
        (spaces.Box(-1, 1, (2,)), np.zeros((2, 1))),
        (spaces.Box(-1, 1, (2, 3)), np.zeros((3, 2))),
        (spaces.Box(-1, 1, (1,)), 0.5),
        (spaces.MultiBinary(3), np.zeros(2)),
        (spaces.MultiDiscrete([2, 2]), np.zeros(1, np.int64)),
        (spaces.Discrete(3), np.zeros(2, np.int64)),
        (spaces.Dict(a=spaces.Box(-1, 1, (2,))), {"a": np.zeros(1)}),
    ],
    ids=str,
)
def test_a_wrong_shape_is_refused_and_never_broadcast(space: gym.Space[Any], observation: Any) -> None:
    with pytest.raises(ValueError, match=r"^observation.* has shape \(.*\), the observation space says \(.*\)$"):
        flattener(space).one(observation)


@pytest.mark.parametrize(
    ("space", "observation"),
    [
        (spaces.Discrete(3), 3),
        (spaces.Discrete(3), -1),
        (spaces.Discrete(3), 1.5),
        (spaces.Discrete(3, start=5), 4),
        (spaces.MultiDiscrete([2, 2]), np.array([0, 2])),
    ],
    ids=str,
)
def test_a_number_that_is_no_choice_is_refused(space: gym.Space[Any], observation: Any) -> None:
    with pytest.raises(ValueError, match=r"^observation must be a whole number up to \d+, got .*$"):
        flattener(space).one(observation)


@pytest.mark.parametrize("observation", [{"b": 1}, 3, None], ids=str)
def test_a_missing_part_is_named(observation: Any) -> None:
    space = spaces.Dict(a=spaces.Box(-1, 1, (2,)))
    with pytest.raises(ValueError, match=r"^observation must be a mapping with 'a', got .*$"):
        flattener(space).one(observation)


@pytest.mark.parametrize(
    "space",
    [
        spaces.Sequence(spaces.Discrete(2)),
        spaces.Graph(spaces.Box(-1, 1, (2,)), None),
        spaces.Text(8),
        Words(),
        spaces.Box(-1, 1, (0,)),
    ],
    ids=lambda space: type(space).__name__,
)
def test_a_space_without_a_fixed_length_is_refused_in_one_line_or_left_out(space: gym.Space[Any]) -> None:
    with pytest.raises(UnsupportedSpaceError, match=r"^observation space .* is not supported: .*$"):
        observation_size(space)
    if isinstance(space, spaces.Box):
        return
    with pytest.warns(UserWarning, match=r"^observation\['mission'\] is left out: .*$"):
        flatten = flattener(spaces.Dict(image=spaces.Box(0, 255, (3,), np.uint8), mission=space))
    assert flatten.one({"image": np.array([1, 2, 3]), "mission": "go"}).tolist() == [1.0, 2.0, 3.0]
    with pytest.warns(UserWarning, match="is left out"), pytest.raises(UnsupportedSpaceError):
        observation_size(spaces.Dict(mission=space))
