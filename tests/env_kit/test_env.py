from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from numba import njit
from numpy.typing import NDArray

from dpsearch.env_kit import KernelEnv, KernelVectorEnv, Task
from dpsearch.envs.poles.env import pole_task
from dpsearch.envs.tmaze import tmaze_pomdp
from dpsearch.kernels.lanes import LANES, OBSERVE, RESET, STEP, EnvKernel, noise_rows
from dpsearch.kernels.philox import ENVIRONMENT, draw, stream_key
from dpsearch.pomdp import TabularPOMDP
from dpsearch.pomdp.task import tabular_task

TaskMaker = Callable[[int], Task]
MODES = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP]


@njit(RESET)
def _drift_reset(floats, ints, noise, lane, state):
    state[0, lane] = noise[0, lane] - 0.5
    state[1, lane] = noise[5, lane] - 0.5


@njit(OBSERVE)
def _drift_observe(floats, ints, state, observation, lanes):
    for lane in range(lanes):
        observation[0, lane] = state[0, lane] * floats[0]


@njit(STEP)
def _drift_step(floats, ints, noise, action, state, reward, terminated, lanes):
    for lane in range(lanes):
        over = abs(state[0, lane]) > 1
        state[0, lane] += 0.3 * min(max(action[0, lane], -1.0), 1.0) + noise[5, lane] - 0.5
        state[1, lane] += 0.1 * min(max(action[1, lane], -1.0), 1.0)
        reward[lane] = 0.0 if over else state[1, lane]
        terminated[lane] = over or abs(state[0, lane]) > 1


def drift_task(max_episode_steps: int) -> Task:
    """A drifting point: two continuous actions, two numbers of state, one of them seen, six draws a step."""
    return Task(
        kernel=EnvKernel(
            *(_drift_reset, _drift_observe, _drift_step),
            floats=np.array([1 / 3]),
            ints=np.zeros(1, np.int64),
            state_size=2,
            observation_size=1,
            action_size=2,
            draws=6,
        ),
        observation_space=spaces.Box(-10, 10, (1,), np.float32),
        action_space=spaces.Box(-1, 1, (2,), np.float32),
        state_space=spaces.Box(-10, 10, (2,), np.float64),
        max_episode_steps=max_episode_steps,
    )


def two_poles(max_episode_steps: int) -> Task:
    return pole_task(2, velocities=True, start_state="generalisation", max_episode_steps=max_episode_steps)


def damped_pole(max_episode_steps: int) -> Task:
    """Without random numbers, and with more in the kernel's state than the state that it tells."""
    start = [2.2, 1.1, -0.05, 0.0]  # about nine steps from the end of the track
    return pole_task(1, velocities=False, reward="damping", start_state=start, max_episode_steps=max_episode_steps)


@pytest.fixture(params=["tmaze", "noisy", "drift", "two poles", "damped pole"])
def make_task(request: pytest.FixtureRequest, noisy_pomdp: TabularPOMDP) -> TaskMaker:
    if "pole" in request.param:
        return two_poles if request.param == "two poles" else damped_pole
    if request.param == "drift":
        return drift_task
    pomdp = tmaze_pomdp(3) if request.param == "tmaze" else noisy_pomdp
    return lambda steps: tabular_task(pomdp, steps)


def random_actions(task: Task, steps: int, n: int) -> NDArray[Any]:
    random = np.random.default_rng(0)
    if isinstance(task.action_space, spaces.Discrete):
        return random.integers(task.action_space.n, size=(steps, n))
    return random.normal(size=(steps, n, *task.action_space.shape)).astype(np.float32)  # also beyond the bounds


def same(ours: Any, theirs: Any) -> bool:
    return data_equivalence(ours, theirs, exact=True)


@pytest.mark.parametrize("n", [1, 16, 37])
@pytest.mark.parametrize("mode", MODES)
def test_a_vector_equals_scalar_environments_bit_for_bit(make_task: TaskMaker, mode: AutoresetMode, n: int) -> None:
    task = make_task(9)
    ours = KernelVectorEnv(task, n, mode)
    theirs = SyncVectorEnv([lambda: KernelEnv(task)] * n, autoreset_mode=mode)
    assert same(ours.reset(seed=11), theirs.reset(seed=11))
    ends = np.zeros(2, int)
    for actions in random_actions(task, 600 // n + 20, n):
        ours_now, theirs_now = ours.step(actions), theirs.step(actions)
        assert same(ours_now, theirs_now)
        ends += [ours_now[2].sum(), ours_now[3].sum()]
    assert ends.min() > 0  # both kinds of end were seen
    assert same(ours.reset(), theirs.reset())
    seeds: list[int | None] = list(range(100, 100 + n))
    assert same(ours.reset(seed=seeds), theirs.reset(seed=seeds))


@pytest.mark.parametrize("seed", [0, 3, 2**40])
def test_a_scalar_environment_equals_its_kernel_bit_for_bit(make_task: TaskMaker, seed: int) -> None:
    task = make_task(12)
    kernel, env = task.kernel, KernelEnv(task)
    key, steps = np.uint64(stream_key(seed)), np.zeros(LANES, np.int64)
    noise = np.empty((noise_rows(kernel.draws), LANES))
    state, action = np.zeros((kernel.state_size, LANES)), np.zeros((kernel.action_size, LANES))
    seen, reward, over = (
        np.empty((kernel.observation_size, LANES)),
        np.empty(LANES),
        np.empty(LANES, np.bool_),
    )
    lane = 5
    for episode in range(4):
        episodes = np.full(LANES, episode, np.uint64)
        draw(key, episodes, steps, ENVIRONMENT, noise, LANES)
        kernel.reset(kernel.floats, kernel.ints, noise, lane, state)
        kernel.observe(kernel.floats, kernel.ints, state, seen, LANES)
        observation, info = env.reset(seed=seed if episode == 0 else None)
        for t, choice in enumerate(random_actions(task, 12, 1)[:, 0], start=1):
            assert (observation == seen[:, lane].astype(np.float32)).all()
            assert same(info["state"], task.hidden(state.T)[lane]) or info["state"] == state[0, lane]
            action[:, lane] = choice
            draw(key, episodes, steps + t, ENVIRONMENT, noise, LANES)
            kernel.step(kernel.floats, kernel.ints, noise, action, state, reward, over, LANES)
            kernel.observe(kernel.floats, kernel.ints, state, seen, LANES)
            observation, value, terminated, truncated, info = env.step(choice)
            assert (value, terminated, truncated) == (reward[lane], over[lane], t >= 12)
            if terminated:
                break


def test_the_same_seed_gives_the_same_episodes_and_another_seed_others(noisy_pomdp: TabularPOMDP) -> None:
    def play(seed: int) -> list[Any]:
        env = KernelEnv(tabular_task(noisy_pomdp, 20))
        env.reset(seed=seed)
        return [env.step(action)[:3] for action in random_actions(env.task, 20, 1)[:, 0]]

    assert same(play(1), play(1))
    assert not same(play(1), play(2))


def test_unseeded_environments_play_different_episodes(noisy_pomdp: TabularPOMDP) -> None:
    task = tabular_task(noisy_pomdp, 30)
    vector = KernelVectorEnv(task, 20)
    vector.reset()
    actions = np.zeros(20, np.int64)
    rewards = np.stack([vector.step(actions)[1] for _ in range(20)])
    assert len({tuple(column) for column in rewards.T}) > 15
    first = [KernelEnv(task).reset()[0] for _ in range(20)]
    assert not all(same(one, first[0]) for one in first)


def test_an_environment_without_a_seed_of_its_own_goes_on_with_its_next_episode(
    noisy_pomdp: TabularPOMDP,
) -> None:
    vector, scalar = KernelVectorEnv(tabular_task(noisy_pomdp, 30), 2), KernelEnv(tabular_task(noisy_pomdp, 30))
    vector.reset(seed=[4, 5])
    vector.reset(seed=[None, 5])
    scalar.reset(seed=4)
    scalar.reset()
    for _ in range(30):
        observation, reward, over, *_ = scalar.step(1)
        observations, rewards, *_ = vector.step(np.array([1, 1]))
        assert same(observations[0], observation)
        assert rewards[0] == reward
        if over:
            break


def test_a_reset_mask_leaves_the_other_environments_alone() -> None:
    vector = KernelVectorEnv(tabular_task(tmaze_pomdp(3), 50), 3)
    vector.reset(seed=0)
    vector.step(np.ones(3, np.int64))
    _, info = vector.reset(options={"reset_mask": np.array([False, True, False])})
    assert info["_state"].tolist() == [False, True, False]
    _, info = vector.step(np.ones(3, np.int64))[3:]
    assert (info["state"] % 4).tolist() == [2, 1, 2]


def test_step_and_render_before_reset_say_what_is_needed() -> None:
    task = tabular_task(tmaze_pomdp(3), 50)
    with pytest.raises(gym.error.ResetNeeded, match="call reset"):
        KernelEnv(task).step(0)
    with pytest.raises(gym.error.ResetNeeded, match="call reset"):
        KernelVectorEnv(task, 2).step(np.zeros(2, np.int64))


@pytest.mark.parametrize("action", [4, -1, 1.0, "east", None, [1], np.nan])
def test_a_scalar_action_outside_the_space_is_refused(action: Any) -> None:
    env = KernelEnv(tabular_task(tmaze_pomdp(3), 50))
    env.reset(seed=0)
    with pytest.raises(ValueError, match="action"):
        env.step(action)


@pytest.mark.parametrize("actions", [[0, 4], [0, -1], [0], 0, [[0, 0]], [0.0, 1.0]])
def test_vector_actions_outside_the_space_are_refused(actions: Any) -> None:
    vector = KernelVectorEnv(tabular_task(tmaze_pomdp(3), 50), 2)
    vector.reset(seed=0)
    with pytest.raises(ValueError, match="action"):
        vector.step(np.array(actions))


@pytest.mark.parametrize("action", [[0.0], 0.0, [0.0, np.nan], [np.inf, 0.0], ["a", "b"]])
def test_continuous_actions_of_wrong_shape_or_not_finite_are_refused(action: Any) -> None:
    env = KernelEnv(drift_task(10))
    env.reset(seed=0)
    with pytest.raises(ValueError, match="action"):
        env.step(action)


def test_a_refused_action_leaves_the_episode_as_it_was() -> None:
    env = KernelEnv(tabular_task(tmaze_pomdp(3), 50))
    env.reset(seed=0)
    env.step(1)
    with pytest.raises(ValueError, match="action"):
        env.step(9)
    assert env.elapsed_steps == 1
    assert env.step(1)[4]["state"] % 4 == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"num_envs": 0}, "num_envs must be at least 1, got 0"),
        ({"autoreset_mode": AutoresetMode.DISABLED}, "NEXT_STEP or SAME_STEP"),
        ({"autoreset_mode": "sometimes"}, "sometimes"),
        ({"render_mode": "rgb_array"}, 'vectorization_mode="sync"'),
    ],
)
def test_bad_arguments_of_a_vector_are_refused(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        KernelVectorEnv(tabular_task(tmaze_pomdp(3), 50), **arguments)


def test_seeds_that_do_not_fit_are_refused() -> None:
    task = tabular_task(tmaze_pomdp(3), 50)
    with pytest.raises(ValueError, match="seed must have 3 entries, got 2"):
        KernelVectorEnv(task, 3).reset(seed=[1, 2])
    with pytest.raises(ValueError, match="reset_mask must have 3 entries, got 2"):
        KernelVectorEnv(task, 3).reset(options={"reset_mask": np.ones(2, np.bool_)})
    with pytest.raises(ValueError, match=r"seed must be in \[0, 2\*\*64\)"):
        KernelEnv(task).reset(seed=2**64)


def test_a_limit_below_one_is_refused() -> None:
    with pytest.raises(ValueError, match="max_episode_steps must be at least 1, got 0"):
        drift_task(0)


def test_what_is_returned_belongs_to_the_caller(make_task: TaskMaker) -> None:
    task = make_task(50)
    vector, untouched = KernelVectorEnv(task, 2), KernelVectorEnv(task, 2)
    vector.reset(seed=0)
    untouched.reset(seed=0)
    for actions in random_actions(task, 10, 2):
        mine = vector.step(actions)
        assert same(mine, untouched.step(actions))
        for array in (*mine[:4], *mine[4].values()):
            array[...] = 1


def test_environments_around_any_kernel_pass_gymnasiums_checks(make_task: TaskMaker) -> None:
    check_env(KernelEnv(make_task(50)), skip_render_check=True)


def test_only_the_render_modes_of_a_class_are_accepted() -> None:
    with pytest.raises(ValueError, match="render_mode must be"):
        KernelEnv(drift_task(10), render_mode="ansi")
