"""A stream of episodes: the same episodes as an engine's, in pieces."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch

from dpsearch.envs.driving.track import Track
from dpsearch.policies import PolicyConfig, RecurrentPolicy
from dpsearch.rollout import EnvironmentFailedError, GymEngine, Pieces, Rollouts, Stream, make_rollouts
from tests.support.toy_envs import Broken, Countdown

KEY = 5


def rollouts(factory: Any = Countdown) -> GymEngine:
    return GymEngine(factory, num_envs=1, max_episode_steps=50)


def policy_for(source: Rollouts) -> RecurrentPolicy:
    config = PolicyConfig(hidden_size=4, init_range=0.7, previous_action=True)
    return RecurrentPolicy.for_spaces(source.observation_space, source.action_space, config, seed=3)


def bent() -> Track:
    """A drive that ends soon: an untrained policy leaves the road at once, and is stuck after 6 steps."""
    return Track(speed_profile=(30.0, 70.0, 60.0), stuck_seconds=0.2)


def flat(pieces: list[Pieces], name: str) -> np.ndarray[Any, Any]:
    """A column after the other."""
    return np.concatenate([getattr(p, name)[: p.lengths[n], n] for p in pieces for n in range(len(p))])


@pytest.mark.parametrize("steps", [1, 5, 12, 100])
def test_the_pieces_are_those_of_whole_episodes_bit_for_bit(steps: int) -> None:
    source = rollouts()
    policy = policy_for(source)
    whole = source.collect(policy, 40, key=KEY)
    stream, wanted = Stream(source, KEY), 120
    pieces = [stream.play(policy, steps) for _ in range(-(-wanted // steps))]
    for name in ("observations", "actions", "rewards"):
        expected = np.concatenate([getattr(whole, name)[: whole.lengths[n], n] for n in range(40)])
        np.testing.assert_array_equal(flat(pieces, name)[:wanted], expected[:wanted])
    finished = np.concatenate([p.finished for p in pieces])
    np.testing.assert_array_equal(finished, whole.returns[: len(finished)])
    assert all(p.steps == steps for p in pieces)


def test_a_piece_goes_on_with_the_memory_that_the_one_before_left() -> None:
    source = rollouts()
    policy = policy_for(source)
    whole, stream = source.collect(policy, 40, key=KEY), Stream(source, KEY)
    everything = torch.from_numpy(whole.observations), torch.from_numpy(whole.actions)
    features = policy.unroll(*everything, whole.lengths).detach().numpy()
    expected = np.concatenate([features[: whole.lengths[n], n] for n in range(40)])
    found = []
    for _ in range(15):
        p = stream.play(policy, 5)
        parts = torch.from_numpy(p.observations), torch.from_numpy(p.actions)
        unrolled = policy.unroll(*parts, p.seen, torch.from_numpy(p.memory)).detach().numpy()
        found += [unrolled[: p.lengths[n], n] for n in range(len(p))]
    np.testing.assert_allclose(np.concatenate(found), expected[:75], atol=1e-5)


def test_what_is_seen_next_follows_what_was_cut_off_and_completes_its_returns() -> None:
    source = rollouts()
    policy, stream = policy_for(source), Stream(source, KEY)
    first, second = stream.play(policy, 5), stream.play(policy, 5)
    if first.terminated[-1]:
        first, second = second, stream.play(policy, 5)
    n, last = len(first) - 1, int(first.lengths[-1])
    assert not first.terminated[n]
    assert not second.begins
    np.testing.assert_array_equal(first.observations[last, n], second.observations[0, 0])
    expected = np.full(first.rewards.shape, 7.0, np.float32)
    returns = first.returns_to_go(0.5, expected)
    assert returns[last - 1, n] == first.rewards[last - 1, n] + 0.5 * 7.0
    assert returns[last - 2, n] == first.rewards[last - 2, n] + 0.5 * returns[last - 1, n]
    assert not returns[~first.mask].any()


def test_what_the_task_ended_earns_nothing_more() -> None:
    source = rollouts()
    policy, stream = policy_for(source), Stream(source, KEY)
    pieces = stream.play(policy, 60)
    assert pieces.terminated.any()
    returns = pieces.returns_to_go(1.0, 1000.0)
    for n in np.flatnonzero(pieces.terminated):
        assert returns[0, n] == pieces.returns[n]


def test_a_car_is_put_back_where_it_left_the_road_and_the_profile_goes_on() -> None:
    asked = []

    class Watched(Track):
        def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
            asked.append(options)
            return super().reset(seed=seed, options=options)

    source = make_rollouts(lambda: Watched(speed_profile=(30.0, 70.0, 60.0), stuck_seconds=0.2))
    stream = Stream(source, KEY)
    pieces = stream.play(policy_for(source), 1500)
    episodes = [options for options in asked if options]
    assert len(episodes) == len(pieces.finished) > 1
    assert [options["driven_steps"] for options in episodes] == np.cumsum(pieces.lengths)[: len(episodes)].tolist()
    assert episodes[-1]["distance"] > 0.0


@pytest.mark.parametrize("before", [1, 7, 400])
def test_a_stream_is_picked_up_again_where_it_was_left(before: int) -> None:
    source = make_rollouts(bent)
    policy = policy_for(source)
    stream = Stream(source, KEY)
    stream.play(policy, before)
    state = stream.state_dict()
    expected = stream.play(policy, 300)
    other = Stream(make_rollouts(bent), KEY)
    other.load_state_dict(state)
    found = other.play(policy, 300)
    for name in ("observations", "actions", "rewards", "lengths", "memory", "finished"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert found.begins == expected.begins


def test_a_stream_that_cannot_be_played_again_says_so() -> None:
    class Whimsical(Countdown):
        def _observation(self) -> Any:
            return super()._observation() + np.float32(np.random.default_rng().random())  # whatever the seed

    source = rollouts(Whimsical)
    policy, stream = policy_for(source), Stream(source, KEY)
    stream.play(policy, 1)
    with pytest.raises(ValueError, match="same place"):
        Stream(source, KEY).load_state_dict(stream.state_dict())


@pytest.mark.parametrize("ready", [lambda: Countdown(), lambda: gym.vector.SyncVectorEnv([Countdown] * 2)])
def test_what_came_ready_made_is_refused(ready: Any) -> None:
    env = ready()
    with pytest.raises(ValueError, match="give an id or a factory"):
        Stream(GymEngine(env, max_episode_steps=50), KEY)
    env.close()


@pytest.mark.parametrize(("how", "at"), [("nan", "step 3 of episode .*: the observation is not"), ("raise", "step 3")])
def test_a_failure_is_named(how: str, at: str) -> None:
    source = rollouts(lambda: Broken(how))
    with pytest.raises(EnvironmentFailedError, match=at):
        Stream(source, KEY).play(policy_for(source), 100)
