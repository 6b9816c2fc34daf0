from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from dpsearch.envs import DoublePole, DoublePoleHidden, SinglePole, SinglePoleHidden, TMaze
from dpsearch.envs.poles.env import PolesEnv, generalisation_starts
from dpsearch.policies import PolicyConfig, RecurrentPolicy
from dpsearch.report.generalisation import balanced_starts, generalisation_test
from dpsearch.rollout import make_rollouts

ROOT = Path(__file__).parents[2]


def policy(env: type[PolesEnv], gains: list[float] | None = None, *, deterministic: bool = True) -> RecurrentPolicy:
    """A policy without memory that pushes, for small observations, in proportion to them."""
    made = env()
    config = PolicyConfig(core="none", hidden_size=1, bias=False)
    policy = RecurrentPolicy.for_spaces(
        made.observation_space, made.action_space, config, deterministic=deterministic, seed=1
    )
    if gains is not None:
        policy.load_vector(np.array([*(0.01 * np.array(gains)), 100.0]))
    return policy


SINGLE = [0.5, 0.6, 2.5, 1.0]  # balances one pole from most starts, but not from those near the ends of the track


def test_each_start_is_judged_by_an_episode_that_begins_there() -> None:
    balanced = balanced_starts(policy(SinglePole, SINGLE), SinglePole, steps=300)
    assert balanced.shape == (625,)
    assert balanced.dtype == np.bool_
    assert 50 < balanced.sum() < 575
    starts = generalisation_starts(1)
    for i in range(0, 625, 7):
        rollouts = make_rollouts(SinglePole(start_state=starts[i]), max_episode_steps=300)
        episode = rollouts.collect(policy(SinglePole, SINGLE), 1, key=0)
        assert balanced[i] == (not episode.terminated[0])
        np.testing.assert_array_equal(episode.observations[0, 0], (starts[i] / [4.8, 2, 0.52, 2]).astype(np.float32))


def test_the_number_of_the_test_counts_the_starts() -> None:
    tested = policy(SinglePole, SINGLE)
    number = generalisation_test(tested, "dpsearch/SinglePole-v0", steps=300)
    assert isinstance(number, int)
    assert number == balanced_starts(tested, SinglePole, steps=300).sum()
    assert generalisation_test(tested, SinglePole, steps=300, threads=2) == number
    assert generalisation_test(tested, SinglePole, steps=1) == 625
    assert generalisation_test(tested, SinglePole, steps=1000) <= number


@pytest.mark.parametrize("env", [SinglePole, SinglePoleHidden, DoublePole, DoublePoleHidden])
def test_every_task_can_be_tested(env: type[PolesEnv]) -> None:
    assert generalisation_test(policy(env), env) == 0  # a new policy balances nothing


def test_arguments_of_the_environment_reach_it() -> None:
    tested = policy(SinglePole, SINGLE)
    stuck = generalisation_test(tested, SinglePole, steps=300, cart_friction=2.0)
    assert stuck != generalisation_test(tested, SinglePole, steps=300)


def test_a_stochastic_policy_can_be_tested_greedily_or_not() -> None:
    tested = policy(DoublePoleHidden, deterministic=False)
    greedy = balanced_starts(tested, steps=8)
    assert (greedy == balanced_starts(tested, steps=8)).all()
    sampled = balanced_starts(tested, steps=8, greedy=False)
    assert (greedy != sampled).any()
    assert (sampled == balanced_starts(tested, steps=8, greedy=False)).all()


def test_wrong_arguments_are_refused() -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'reward'"):
        generalisation_test(policy(DoublePole), TMaze)
    with pytest.raises(ValueError, match="does not take reward, which the test sets itself"):
        generalisation_test(policy(DoublePole), DoublePole, reward="damping")
    with pytest.raises(ValueError, match="steps must be at most 100000, got 100001"):
        generalisation_test(policy(DoublePole), DoublePole, steps=100_001)
    with pytest.raises(ValueError, match="steps=0: at least 1"):
        generalisation_test(policy(DoublePole), DoublePole, steps=0)
    with pytest.raises(ValueError, match="maps 6 observations to 1 actions, the environment has 3 and 1"):
        generalisation_test(policy(DoublePole))


WARM = """
from numba.core import event
with event.install_recorder("numba:compile") as recorder:
    from dpsearch.envs import SinglePole
    from dpsearch.policies import RecurrentPolicy
    from dpsearch.report.generalisation import generalisation_test
    env = SinglePole(render_mode="rgb_array")
    policy = RecurrentPolicy.for_spaces(env.observation_space, env.action_space, deterministic=True)
    generalisation_test(policy, SinglePole, steps=10)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.render()
print([record.data["dispatcher"].py_func.__name__ for _, record in recorder.buffer if record.is_start])
"""


def test_a_warm_start_compiles_nothing() -> None:
    for _ in ("the first may compile and keep on disk", "the second finds all of it there"):
        run = subprocess.run([sys.executable, "-c", WARM], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
