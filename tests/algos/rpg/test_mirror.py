"""Episodes and their mirror images: what is doubled, what the gradient makes of it, and what is carried on."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dpsearch.algos import RPG
from dpsearch.algos.rpg.config import RPGConfig
from dpsearch.algos.rpg.mirror import Mirror
from dpsearch.envs.driving.track import Track
from dpsearch.policies import PolicyConfig
from dpsearch.rollout import Pieces, Stream, make_rollouts
from tests.support.algorithms import NO_BASELINE, gradients

POLES = [-1.0] * 4  # two angles and a place seen, one action
ROAD = [1.0, -1.0, -1.0, -1.0, -1.0]  # a speed is the same in a mirror


def short_drive() -> Track:
    return Track(speed_profile=(30.0, 70.0, 60.0), stuck_seconds=0.2)


def driver(**settings: Any) -> RPG:
    policy = PolicyConfig(hidden_size=4, init_range=0.3, previous_action=True, noise_memory=0.5)
    given = {"gradient_length": None, "learning_rate": 1e-4, "natural_step": 0.1, "mirror": True}
    return RPG(short_drive, policy=policy, seed=2, **given | settings)


def balancer(**settings: Any) -> RPG:
    """An Elman net without biases: what it does in the mirror is what a mirror shows it doing."""
    policy = PolicyConfig(core="elman", hidden_size=4, init_range=0.3, bias=False)
    given = {
        "natural_step": 0.01,
        "gradient_length": None,
        "gamma": 0.9,
        "baseline": NO_BASELINE,
    }
    rollouts = make_rollouts("dpsearch/DoublePoleHidden-v0")
    rollouts.mirror_signs = POLES
    return RPG(rollouts, policy=policy, seed=1, **given | settings)


def test_behind_the_episodes_are_their_images_which_earned_the_same() -> None:
    rpg = balancer()
    played = rpg.play_batch(5)
    both = Mirror(POLES, rpg.policy).doubled(played)
    assert len(both) == 10
    for original, doubled in ((played.observations, both.observations), (played.actions, both.actions)):
        np.testing.assert_array_equal(doubled[:, :5], original)
        np.testing.assert_array_equal(doubled[:, 5:], -original)
    for name in ("lengths", "terminated", "returns", "rewards", "mask"):
        np.testing.assert_array_equal(getattr(both, name)[..., 5:], getattr(played, name))
    np.testing.assert_array_equal(both.returns_to_go(0.9)[:, 5:], played.returns_to_go(0.9))


def test_a_policy_that_is_the_same_in_the_mirror_learns_the_same_from_an_image() -> None:
    steps = []
    for mirror in (False, True):
        rpg = balancer(mirror=mirror)
        with torch.no_grad():
            rpg.policy.readout.weight[1] = 0.0  # of the deviation, which then is the same in the mirror too
        rpg.backpropagate(rpg.play_batch(10))
        of_the_deviation = rpg.policy.readout.weight.grad
        assert of_the_deviation is not None
        assert not mirror or of_the_deviation[1].abs().max() < 1e-5  # what differs in the mirror cancels out
        of_the_deviation[1] = 0.0
        steps.append(gradients(rpg) / np.linalg.norm(gradients(rpg)))
    assert steps[0] @ steps[1] > 0.999


def test_images_are_taught_by_the_noise_in_the_actions_not_by_the_actions() -> None:
    rpg = balancer(mirror=True)
    assert rpg.mirror is not None
    eligibilities = torch.arange(24.0).view(3, 4, 2)
    kept = eligibilities[:, :2].clone()
    rpg.mirror.reflect(eligibilities)
    torch.testing.assert_close(eligibilities[:, :2], kept)
    torch.testing.assert_close(eligibilities[:, 2:], kept * torch.tensor([-1.0, 1.0]))  # the mean, and the deviation


def test_the_memory_of_a_mirrored_stream_is_carried_on() -> None:
    rpg = driver()
    stream, mirror = Stream(rpg.rollouts, rpg.training_key), Mirror(ROAD, rpg.policy)
    seen: list[NDArray[np.float32]] = []
    done: list[NDArray[np.float32]] = []
    for _ in range(8):
        pieces = stream.play(rpg.policy, 60)
        both = mirror.doubled(pieces)
        assert isinstance(both, Pieces)
        assert not both.memory[len(pieces) + 1 :].any()
        if len(pieces) > 1 or pieces.begins:
            seen, done = [], []
        elif seen:
            history = torch.from_numpy(np.concatenate(seen)), torch.from_numpy(np.concatenate(done))
            _, expected = rpg.policy(history[0][:, None], None, history[1][:, None])
            np.testing.assert_allclose(both.memory[1], expected[0].detach().numpy(), rtol=1e-4, atol=1e-5)
            return
        steps = int(pieces.lengths[-1])
        seen.append(both.observations[:steps, -1])
        done.append(both.actions[:steps, -1])
    pytest.fail("no episode went on for two updates")


@pytest.mark.parametrize("settings", [{"update_steps": 64, "baseline": "quadratic"}, {"batch_size": 3}])
def test_it_goes_on_bit_for_bit(settings: dict[str, Any], tmp_path: Path) -> None:
    whole = driver(**settings).learn(total_updates=5)
    driver(**settings).learn(total_updates=3).save(tmp_path / "half.pt")
    other = RPG.load(tmp_path / "half.pt", env=short_drive).learn(total_updates=5)
    np.testing.assert_array_equal(other.policy.vector(), whole.policy.vector())


def test_signs_that_do_not_fit_are_refused() -> None:
    policy = balancer().policy
    for signs in ([1.0, -1.0], [0.5, *POLES[1:]]):
        with pytest.raises(ValueError, match="not a 1 or -1 for each of 3 numbers observed and 1 of an action"):
            Mirror(signs, policy)


def test_an_environment_that_declares_no_signs_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^mirror must be false: this environment declares no mirror_signs"):
        RPG("Pendulum-v1", natural_step=0.1, gradient_length=None, mirror=True)


def test_a_policy_that_is_not_gaussian_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^mirror must be false: it needs a Gaussian policy"):
        RPG("dpsearch/TMaze-v0", natural_step=0.1, gradient_length=None, mirror=True)


@pytest.mark.parametrize(
    "settings",
    [
        {"mirror": True},
        {"mirror": ROAD, "natural_step": 0.1, "gradient_length": None},
        {"mirror": True, "natural_step": 0.1, "gradient_length": None, "baseline": "history", "update_steps": 100},
    ],
)
def test_settings_that_it_does_not_go_with_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="mirror must be true or false; false without a natural_step"):
        RPGConfig(**settings)


def test_images_do_not_use_up_the_patience_of_a_start() -> None:
    rpg = balancer(mirror=True, restart_episodes=25, restart_gain=100.0, batch_size=10)
    rpg.learn(total_updates=6)  # the first 25 episodes, in three batches, set the bar; three more use up patience
    assert rpg.starts == 1
    rpg.learn(total_updates=7)
    assert rpg.starts == 2


def test_what_is_lopsided_in_a_policy_is_left_as_it_is() -> None:
    """The images' share of a gradient is that of a symmetric policy."""
    rpg = balancer(mirror=True)
    assert rpg.mirror is not None
    outputs = torch.ones(1, 1, 2)
    alone = torch.randn(1, 1, 2, generator=torch.Generator().manual_seed(0))
    both = torch.cat((alone, torch.zeros(1, 1, 2)), 1)
    rpg.mirror.reflect(both)
    constant = (both * torch.cat((outputs, outputs), 1)).sum((0, 1))  # of a bias of the mean, and of the deviation
    assert constant[0] == 0.0
    assert constant[1] == 2.0 * alone[0, 0, 1]
