"""The natural gradient against the Fisher matrix written out, and the divergence that it promises."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from dpsearch.algos import RPG
from dpsearch.algos.rpg.natural_gradient import natural_step
from dpsearch.policies import PolicyConfig
from tests.support.algorithms import gradients

ENVS = {"dpsearch/TMaze-v0": {"corridor_length": 2}, "Pendulum-v1": {}}  # discrete and continuous actions


def natural_rpg(env: str, **settings: Any) -> RPG:
    policy = PolicyConfig(hidden_size=2, init_range=0.5)
    return RPG(
        env,
        env_kwargs=ENVS[env],
        max_episode_steps=9,
        policy=policy,
        batch_size=30,
        **{"optimizer": "SGD", "learning_rate": 1.0, "gradient_length": None, "baseline": "history", **settings},
    )


@pytest.mark.parametrize("env", ENVS)
@pytest.mark.parametrize("damping", [0.1, 1.0])
def test_it_solves_the_equation_with_the_fisher_matrix_written_out(env: str, damping: float) -> None:
    rpg = natural_rpg(env)
    episodes = rpg.play_batch(30)
    observations, actions = torch.from_numpy(episodes.observations), torch.from_numpy(episodes.actions)
    mask, parameters = episodes.mask, rpg.policy.free_parameters()
    outputs, _ = rpg.policy(observations, actions=actions)
    random = torch.Generator().manual_seed(1)
    gradient = [torch.randn(p.shape, generator=random) for p in parameters]
    divergence = 1e-6  # so little that nothing bends
    found = natural_step(
        rpg.policy,
        gradient,
        outputs,
        lambda policy: policy(observations, actions=actions)[0],
        mask,
        damping,
        divergence,
    )

    size, k = sum(p.numel() for p in parameters), outputs.shape[-1]
    fisher = np.zeros((size, size))
    for t, b in np.argwhere(mask):
        rows = [torch.autograd.grad(outputs[t, b, i], parameters, retain_graph=True) for i in range(k)]
        jacobian = np.stack([np.concatenate([part.numpy().ravel() for part in row]) for row in rows])
        information = np.stack([rpg.policy.head.fisher(outputs[t, b].detach(), e).numpy() for e in torch.eye(k)])
        fisher += jacobian.T @ information @ jacobian / mask.sum()
    g = np.concatenate([part.numpy().ravel() for part in gradient])
    exact = np.linalg.solve(fisher + damping * np.eye(size), g)
    x = np.concatenate([part.numpy().ravel() for part in found])
    exact *= np.sqrt(2.0 * divergence / (g @ exact))
    assert np.linalg.norm(x - exact) < 0.05 * np.linalg.norm(exact)


@pytest.mark.parametrize("env", ENVS)
@pytest.mark.parametrize(("divergence", "least", "most"), [(1e-5, 0.75, 1.2), (0.1, 0.0, 1.2)])
def test_a_step_changes_the_policy_by_the_divergence_asked_for(
    env: str, divergence: float, least: float, most: float
) -> None:
    rpg = natural_rpg(env, natural_step=divergence, damping=1e-3)
    episodes = rpg.play_batch(30)
    observations, actions = torch.from_numpy(episodes.observations), torch.from_numpy(episodes.actions)
    mask = torch.from_numpy(episodes.mask)
    before = rpg.policy(observations, actions=actions)[0].detach()[mask]
    rpg.backpropagate(episodes)
    rpg.optimizer.step()
    change = rpg.policy(observations, actions=actions)[0].detach()[mask] - before
    found = float((change * rpg.policy.head.fisher(before, change)).sum(-1).mean()) / 2.0
    assert least * divergence <= found <= most * divergence


def test_a_gradient_that_is_not_finite_stops_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    rpg = natural_rpg("dpsearch/TMaze-v0", natural_step=1e-3, baseline="constant")
    episodes = rpg.play_batch(30)
    episodes.rewards[:] = np.nan
    monkeypatch.setattr(rpg, "play_batch", lambda count: episodes)
    with pytest.raises(FloatingPointError, match="not finite"):
        rpg.update()


def test_the_size_of_rewards_does_not_matter() -> None:
    found = []
    for factor in (1.0, 1000.0):
        rpg = natural_rpg("dpsearch/TMaze-v0", natural_step=1e-3, baseline="constant")
        episodes = rpg.play_batch(30)
        episodes.rewards[:] *= factor
        rpg.backpropagate(episodes)
        found.append(gradients(rpg))
    np.testing.assert_allclose(found[0], found[1], rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize(
    "refused", [{"gradient_length": 0.3}, {"baseline": "shared"}, {"natural_step": 0.0}, {"optimizer": "Adam"}]
)
def test_it_does_not_go_with_what_would_undo_it(refused: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="natural_step must be positive or null"):
        natural_rpg("dpsearch/TMaze-v0", **{"natural_step": 0.01, **refused})
