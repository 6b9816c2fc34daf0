"""The shared baseline: a read-out of the policy's memory, which it teaches."""

from __future__ import annotations

import torch

from tests.support.algorithms import small_rpg


def test_it_learns_to_expect_more_than_the_mean_return() -> None:
    rpg = small_rpg(baseline={"kind": "shared", "weight": 1.0})
    episodes = rpg.play_batch(300)
    returns, mask = episodes.returns_to_go(1.0), episodes.mask
    optimizer = torch.optim.Adam(rpg.parameters, lr=0.02)
    for _ in range(300):
        optimizer.zero_grad()
        features, _ = rpg.policy.remember(torch.from_numpy(episodes.observations))
        expected, error = rpg.baseline(episodes, features, returns, mask)
        assert error is not None
        error.backward()
        optimizer.step()
    assert ((returns - expected)[mask]).var() < 0.95 * returns[mask].var()
