"""RPG online, on one stream that goes on: cut gradients, exact resume, and a car that learns to steer."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from dpsearch.algos import RPG
from dpsearch.algos.baselines import BASELINES
from dpsearch.algos.rpg.config import RPGConfig
from dpsearch.envs.driving.track import Track
from dpsearch.policies import PolicyConfig
from dpsearch.rollout import Pieces, Stream
from tests.support.toy_envs import Countdown


def short_drive() -> Track:
    return Track(speed_profile=(30.0, 70.0, 60.0), stuck_seconds=0.2)


def driver(**settings: Any) -> RPG:
    policy = PolicyConfig(hidden_size=4, init_range=0.3, previous_action=True)
    return RPG(short_drive, policy=policy, seed=2, **{"gradient_length": None, "learning_rate": 1e-4, **settings})


@pytest.mark.parametrize("baseline", BASELINES)
def test_the_gradient_is_that_of_the_unrolled_pieces_cut_off_at_the_update(baseline: str) -> None:
    weightless = {"kind": "shared", "weight": 0.0} if baseline == "shared" else baseline
    rpg = driver(update_steps=70, baseline=weightless, gamma=0.9)
    rpg.update()  # so that there is something to carry on, and a baseline
    pieces = rpg.source.play()
    assert isinstance(pieces, Pieces)
    assert not pieces.begins
    for parameter in rpg.parameters:
        parameter.grad = None
    observations, actions = torch.from_numpy(pieces.observations), torch.from_numpy(pieces.actions)
    features = rpg.policy.unroll(observations, actions, pieces.seen, torch.from_numpy(pieces.memory))
    b = np.broadcast_to(rpg.baseline.expected(pieces, features), pieces.rewards.shape)
    rpg.backpropagate(pieces)
    found = [p.grad for p in rpg.policy.free_parameters()]
    gain = torch.zeros(())
    for n, length in enumerate(pieces.lengths):  # step by step, one piece after the other
        state = torch.from_numpy(pieces.memory[n : n + 1])
        follows = 0.0 if pieces.terminated[n] else float(b[length, n])
        returns = [follows]
        for reward in pieces.rewards[:length, n][::-1]:
            returns.append(float(reward) + 0.9 * returns[-1])
        returns = returns[:0:-1]
        for t in range(length):
            action = torch.from_numpy(pieces.actions[t, n])[None]
            outputs, state = rpg.policy(torch.from_numpy(pieces.observations[t, n])[None, None], state, action[None])
            gain = gain + rpg.policy.head.log_prob(outputs[0], action)[0] * (returns[t] - float(b[t, n]))
    expected = torch.autograd.grad(-gain, rpg.policy.free_parameters())
    for mine, theirs in zip(found, expected, strict=True):
        assert mine is not None
        torch.testing.assert_close(mine, theirs, rtol=2e-3, atol=2e-3 * float(theirs.abs().max()))


@pytest.mark.parametrize("baseline", BASELINES)
def test_it_goes_on_bit_for_bit_from_the_middle_of_an_episode(baseline: str, tmp_path: Path) -> None:
    whole = driver(update_steps=64, baseline=baseline, trace=0.9, normalise_advantages=True)
    rows: list[dict[str, float]] = []
    whole.learn(total_updates=8, callback=lambda _, metrics: rows.append(metrics))
    half = driver(update_steps=64, baseline=baseline, trace=0.9, normalise_advantages=True).learn(total_updates=5)
    half.save(tmp_path / "half.pt")
    other = RPG.load(tmp_path / "half.pt", env=short_drive)
    again: list[dict[str, float]] = []
    other.learn(total_updates=8, callback=lambda _, metrics: again.append(metrics))
    np.testing.assert_array_equal(other.policy.vector(), whole.policy.vector())
    assert (other.episodes, other.env_steps) == (whole.episodes, whole.env_steps)
    for found, expected in zip(again, rows[5:], strict=True):
        assert {k: v for k, v in found.items() if "time" not in k} == {
            k: v for k, v in expected.items() if "time" not in k
        }


def test_the_history_baseline_carries_its_memory_on_too() -> None:
    still = {"kind": "history", "learning_rate": 1e-12}
    rpg, twin = (driver(baseline=still) for _ in range(2))
    stream, nothing = Stream(rpg.rollouts, rpg.training_key), torch.zeros(0)
    first, second = stream.play(rpg.policy, 40), stream.play(rpg.policy, 40)
    for pieces in (first, second):
        expected = rpg.baseline.expected(pieces, nothing)
        rpg.baseline(pieces, nothing, pieces.rewards, pieces.mask)
    twin.baseline(second, nothing, second.rewards, second.mask)  # the scale of returns, without the memory
    twin.baseline.load_state_dict({**rpg.baseline.state_dict(), "carried": torch.zeros(0)})
    forgetful = twin.baseline.expected(second, nothing)
    assert isinstance(expected, np.ndarray)
    assert isinstance(forgetful, np.ndarray)
    assert not np.allclose(expected[:5, 0], forgetful[:5, 0])


def test_settings_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ValueError, match="update_steps"):
        RPGConfig(update_steps=0)
    with pytest.raises(ValueError, match="update_steps"):
        RPGConfig(update_steps=10, batch_steps=100)
    with pytest.raises(ValueError, match="give an id or a factory"):
        RPG(Countdown(), update_steps=10, max_episode_steps=20)


def test_it_learns_from_other_tasks_that_go_on() -> None:
    rpg = RPG(Countdown, update_steps=50, gradient_length=0.3, max_episode_steps=20, seed=1)
    rewards: list[float] = []
    rpg.learn(total_updates=60, callback=lambda _, metrics: rewards.append(metrics["reward"]))
    assert rewards[-1] > 0.9  # it pays the action it gets, 0 or 1
    assert rpg.headline == f"reward {rewards[-1]:,.4g} a step"
