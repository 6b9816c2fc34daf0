"""Where a kernel's arrays are in memory is of no account, though LLVM chooses between loops by that."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dpsearch.envs.driving.rules import OBSERVATIONS
from dpsearch.envs.driving.track import Track
from dpsearch.envs.poles.env import DoublePoleHidden
from dpsearch.kernels.lanes import LANES, WIDTH, EnvKernel, noise_rows

ENVS: dict[str, Callable[[], Any]] = {
    "poles": DoublePoleHidden,
    "damping": lambda: DoublePoleHidden(reward="damping"),
    "track": lambda: Track(observations=tuple(OBSERVATIONS), start="random"),
}


def side_by_side(shapes: list[tuple[int, ...]], random: np.random.Generator) -> list[NDArray[np.float64]]:
    """Arrays of zeros next to one another in any order."""
    sizes = [int(np.prod(shape)) for shape in shapes]
    buffer, first, arrays = np.zeros(sum(sizes)), 0, {}
    for k in random.permutation(len(shapes)).tolist():
        arrays[k] = buffer[first : first + sizes[k]].reshape(shapes[k])
        first += sizes[k]
    return [arrays[k] for k in range(len(shapes))]


def stepped(kernel: EnvKernel, arrays: list[NDArray[np.float64]], noise: NDArray[np.float64], lanes: int) -> list[Any]:
    state, action, reward, seen = arrays
    ended = np.zeros(LANES, np.bool_)
    kernel.step(kernel.floats, kernel.ints, noise, action, state, reward, ended, lanes)
    kernel.observe(kernel.floats, kernel.ints, state, seen, lanes)
    return [array[..., :lanes].copy() for array in (state, reward, seen, ended)]


@pytest.mark.parametrize("name", ENVS)
def test_a_step_is_the_same_wherever_its_arrays_are(name: str) -> None:
    kernel, random = ENVS[name]().kernel, np.random.default_rng(0)
    noise = random.random((noise_rows(kernel.draws), LANES))
    state = np.zeros((kernel.state_size, LANES))
    for lane in range(LANES):
        kernel.reset(kernel.floats, kernel.ints, noise, lane, state)
    shapes = [state.shape, (kernel.action_size, LANES), (LANES,), (kernel.observation_size, LANES)]
    for step in range(300):
        action = random.normal(size=shapes[1])
        for lanes in range(WIDTH, LANES + 1, WIDTH):
            apart = [np.zeros(shape) for shape in shapes]
            together = side_by_side(shapes, random)
            for arrays in (apart, together):
                arrays[0][:], arrays[1][:] = state, action
            for one, other in zip(
                stepped(kernel, apart, noise, lanes), stepped(kernel, together, noise, lanes), strict=True
            ):
                np.testing.assert_array_equal(one, other, err_msg=f"step {step}, {lanes} lanes")
        state = apart[0]
