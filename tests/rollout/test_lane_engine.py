import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from gymnasium import spaces

from dpsearch.envs import TMaze
from dpsearch.kernels.philox import stream_key
from dpsearch.policies import CORES, Categorical, Deterministic, PolicyConfig, RecurrentPolicy
from dpsearch.rollout import Episodes, LaneEngine

ROOT = Path(__file__).parents[2]
SEED = 5
KEY = stream_key(SEED)


def rollouts(corridor_length: int = 4, max_steps: int = 60, threads: int = 1) -> LaneEngine:
    env = TMaze(corridor_length)
    return LaneEngine(
        env.kernel,
        max_steps,
        threads,
        observation_space=env.observation_space,
        action_space=env.action_space,
    )


def policy(core: str = "lstm", seed: int = 0) -> RecurrentPolicy:
    config = PolicyConfig(core, hidden_size=5, init_range=0.5)
    return RecurrentPolicy.for_spaces(TMaze().observation_space, TMaze().action_space, config, seed=seed)


def assert_same(a: Episodes, b: Episodes) -> None:
    for name in ("observations", "actions", "rewards", "lengths", "terminated", "returns"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


@pytest.mark.parametrize("threads", [2, 4])
def test_results_do_not_depend_on_the_number_of_threads(threads: int) -> None:
    many = rollouts(threads=threads)
    assert_same(rollouts().collect(policy(), 70, key=KEY), many.collect(policy(), 70, key=KEY))
    population = np.stack([policy(seed=s).vector() for s in range(9)])
    numbers = np.arange(45).reshape(9, 5)
    expected = rollouts().evaluate(policy(), population, key=KEY, episodes=numbers)
    np.testing.assert_array_equal(many.evaluate(policy(), population, key=KEY, episodes=numbers), expected)
    many.close()


def test_results_do_not_depend_on_how_episodes_are_split_into_calls() -> None:
    whole = rollouts().collect(policy(), 40, key=KEY, first_episode=3)
    start = 0
    for n in (1, 22, 17):
        part = rollouts().collect(policy(), n, key=KEY, first_episode=3 + start)
        columns = slice(start, start + n)
        steps = len(part.rewards)
        np.testing.assert_array_equal(part.lengths, whole.lengths[columns])
        np.testing.assert_array_equal(part.returns, whole.returns[columns])
        np.testing.assert_array_equal(part.observations, whole.observations[:steps, columns])
        np.testing.assert_array_equal(part.actions, whole.actions[:steps, columns])
        start += n


def test_other_keys_and_numbers_give_other_episodes() -> None:
    plays = [
        rollouts().collect(policy(), 20, key=key, first_episode=first).actions[:2].ravel().tolist()
        for key, first in ((KEY, 0), (KEY + 1, 0), (KEY, 20), (KEY, 2**40))
    ]
    assert len({tuple(play) for play in plays}) == 4


@pytest.mark.parametrize("core", list(CORES))
def test_recorded_episodes_are_those_of_the_scalar_environment(core: str) -> None:
    env = TMaze(3, max_episode_steps=40)
    episodes = rollouts(3, max_steps=40).collect(policy(core), 50, key=KEY)
    assert set(episodes.terminated) == {True, False}
    for b, length in enumerate(episodes.lengths):
        observation, _ = env.reset(seed=SEED if b == 0 else None)
        total, terminated, truncated = 0.0, False, False
        for t in range(length):
            assert not terminated
            assert not truncated
            np.testing.assert_array_equal(episodes.observations[t, b], observation)
            action = int(episodes.actions[t, b, 0])
            observation, reward, terminated, truncated, _ = env.step(action)
            assert episodes.rewards[t, b] == np.float32(reward)
            total += reward
        assert terminated or truncated
        assert terminated == episodes.terminated[b]
        assert episodes.returns[b] == total


def test_candidates_play_as_their_weights_would_alone() -> None:
    candidates = [policy(seed=s) for s in range(20)]
    population = np.stack([candidate.vector() for candidate in candidates])
    numbers = np.arange(60).reshape(20, 3)
    returns, lengths = rollouts().evaluate(policy(), population, key=KEY, episodes=numbers)
    for i, candidate in enumerate(candidates):
        alone = rollouts().collect(candidate, 3, key=KEY, first_episode=3 * i)
        np.testing.assert_array_equal(lengths[i], alone.lengths)
        np.testing.assert_allclose(returns[i], alone.returns, rtol=1e-12)


def test_equal_candidates_with_equal_episode_numbers_have_equal_returns() -> None:
    population = np.tile(policy().vector(), (7, 1))
    numbers = np.tile([4, 9, 2], (7, 1))
    returns, lengths = rollouts().evaluate(policy(), population, key=KEY, episodes=numbers)
    assert (returns == returns[0]).all()
    assert (lengths == lengths[0]).all()


@pytest.mark.parametrize("n_episodes", [1, 15, 16, 17, 100])
def test_it_plays_as_many_episodes_as_asked_for_and_pads_with_zeros(n_episodes: int) -> None:
    episodes = rollouts().collect(policy(), n_episodes, key=KEY)
    assert len(episodes) == n_episodes
    longest = episodes.lengths.max()
    assert episodes.lengths.min() >= 1
    assert episodes.observations.shape == (longest, n_episodes, 3)
    assert episodes.actions.shape == (longest, n_episodes, 1)
    assert episodes.rewards.shape == (longest, n_episodes)
    for array in (episodes.observations, episodes.actions, episodes.rewards):
        assert not array[~episodes.mask].any()
    assert episodes.observations[episodes.mask].any(axis=1).all()


def test_an_episode_ends_at_the_step_cap() -> None:
    episodes = rollouts(corridor_length=50, max_steps=7).collect(policy(), 20, key=KEY)
    assert (episodes.lengths == 7).all()
    assert not episodes.terminated.any()


def test_without_a_record_the_outcome_is_the_same() -> None:
    recorded = rollouts().collect(policy(), 20, key=KEY)
    outcome = rollouts().collect(policy(), 20, key=KEY, record=False)
    assert (len(outcome.observations), len(outcome.actions), len(outcome.rewards)) == (0, 0, 0)
    np.testing.assert_array_equal(outcome.returns, recorded.returns)
    np.testing.assert_array_equal(outcome.lengths, recorded.lengths)


def test_a_greedy_policy_takes_the_most_probable_actions() -> None:
    episodes = rollouts().collect(policy(), 20, key=KEY, greedy=True)
    with torch.no_grad():
        outputs, _ = policy()(torch.from_numpy(episodes.observations))
    expected = policy().head.mode(outputs).numpy()
    np.testing.assert_array_equal(episodes.actions[episodes.mask], expected[episodes.mask])


def test_it_can_be_closed_and_used_again() -> None:
    threaded = rollouts(threads=2)
    before = threaded.collect(policy(), 20, key=KEY)
    threaded.close()
    threaded.close()
    assert_same(threaded.collect(policy(), 20, key=KEY), before)
    threaded.close()


def test_a_policy_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="maps 2 observations to 1 actions, the environment has 3 and 1"):
        rollouts().collect(RecurrentPolicy(2, Categorical([4])), 1, key=KEY)
    with pytest.raises(ValueError, match="maps 3 observations to 2 actions"):
        rollouts().collect(RecurrentPolicy(3, Deterministic(2)), 1, key=KEY)


def test_arguments_that_do_not_fit_are_refused() -> None:
    vector = policy().vector()
    with pytest.raises(ValueError, match=r"\(1, \d+\) and \(2, 1\)"):
        rollouts().evaluate(policy(), vector[None], key=KEY, episodes=[[0], [1]])
    with pytest.raises(ValueError, match=rf"{len(vector)} free parameters, got weight vectors of 3"):
        rollouts().evaluate(policy(), np.zeros((2, 3)), key=KEY, episodes=[[0], [1]])
    with pytest.raises(ValueError, match="n_episodes"):
        rollouts().collect(policy(), 0, key=KEY)
    space = spaces.Discrete(2)
    for max_steps, threads in ((0, 1), (1, 0)):
        with pytest.raises(ValueError, match="must be positive"):
            LaneEngine(TMaze().kernel, max_steps, threads, observation_space=space, action_space=space)


WARM = """
from numba.core import event
with event.install_recorder("numba:compile") as recorder:
    from dpsearch.policies import CORES, PolicyConfig, RecurrentPolicy
    from dpsearch.rollout import make_rollouts
    rollouts = make_rollouts("dpsearch/TMaze-v0")
    for core in CORES:
        config = PolicyConfig(core=core)
        policy = RecurrentPolicy.for_spaces(rollouts.observation_space, rollouts.action_space, config)
        rollouts.collect(policy, 20, key=1).returns_to_go(0.98)
        rollouts.collect(policy, 20, key=1, greedy=True)
        rollouts.evaluate(policy, policy.vector()[None], key=1, episodes=[[0, 1]])
print([record.data["dispatcher"].py_func.__name__ for _, record in recorder.buffer if record.is_start])
"""


def test_a_warm_start_compiles_nothing() -> None:
    for _ in range(2):
        run = subprocess.run([sys.executable, "-c", WARM], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"


ON_DEMAND = """
from dpsearch.kernels.lanes import FORWARD_LANES, FORWARD_SHARED, FORWARD_SINGLE, SAMPLE
from dpsearch.policies import CORES, RecurrentPolicy
from dpsearch.rollout import make_rollouts
from dpsearch.rollout.lane_loop import play

def versions(kernel):
    return kernel.signatures

{make}
policy = RecurrentPolicy.for_spaces(rollouts.observation_space, rollouts.action_space)
head, step = policy.head, policy.core.step
assert not any(map(versions, [*(core.step for core in CORES.values()), head.compiled_sample, head.compiled_mode, play]))
rollouts.collect(policy, 2, key=1)
assert versions(step) == [FORWARD_SINGLE.args]
assert (versions(head.compiled_sample), versions(head.compiled_mode)) == ([SAMPLE.args], [])
rollouts.evaluate(policy, policy.vector()[None], key=1, episodes=[[0, 1]])
assert versions(step) == [FORWARD_SINGLE.args, FORWARD_LANES.args]
rollouts.collect(policy, 2, key=1, greedy=True)
assert versions(step) == [FORWARD_SINGLE.args, FORWARD_LANES.args, FORWARD_SHARED.args]
assert (versions(head.compiled_sample), versions(head.compiled_mode)) == ([SAMPLE.args], [SAMPLE.args])
assert len(versions(play)) in (0, 3)
assert not any(versions(core.step) for core in CORES.values() if core.step is not step)
"""
ENGINES = {
    "lanes": "rollouts = make_rollouts('dpsearch/TMaze-v0')",
    "gymnasium": "rollouts = make_rollouts('CartPole-v1', max_episode_steps=9)",
}


@pytest.mark.parametrize("engine", ENGINES)
def test_a_kernel_is_compiled_for_what_a_run_needs_and_no_more(engine: str) -> None:
    code = ON_DEMAND.format(make=ENGINES[engine])
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


def test_it_can_be_sent_to_another_process() -> None:
    ours = rollouts()
    expected = ours.collect(policy(), 20, key=KEY)
    assert_same(pickle.loads(pickle.dumps(ours)).collect(policy(), 20, key=KEY), expected)
