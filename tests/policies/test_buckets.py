"""Episodes of like length run together give what each gives alone."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dpsearch.policies import CORES, PolicyConfig, RecurrentPolicy
from dpsearch.policies.buckets import STEP_COST, buckets
from dpsearch.policies.heads import Categorical


def unequal(n: int, seed: int = 0) -> NDArray[np.int64]:
    return np.minimum(np.random.default_rng(seed).geometric(1 / 30, n), 300).astype(np.int64)


def cost(groups: list[NDArray[np.int64]], lengths: NDArray[np.int64]) -> int:
    return sum(int(lengths[group].max()) * (STEP_COST + len(group)) for group in groups)


@pytest.mark.parametrize("n", [1, 2, 7, 100, 400])
def test_every_episode_is_in_one_bucket_and_the_longest_leads_each(n: int) -> None:
    lengths = unequal(n)
    groups = buckets(lengths)
    np.testing.assert_array_equal(np.sort(np.concatenate(groups)), np.arange(n))
    for group in groups:
        assert lengths[group[0]] == lengths[group].max()


def test_they_are_split_where_it_saves_much_and_only_there() -> None:
    lengths = unequal(200)
    assert cost(buckets(lengths), lengths) < 0.6 * cost([np.arange(200)], lengths)
    assert len(buckets(np.full(200, 300))) == 1
    assert len(buckets(unequal(3))) == 1


@pytest.mark.parametrize("core", list(CORES))
@pytest.mark.parametrize("previous_action", [True, False])
def test_features_and_gradients_are_those_of_one_call(core: str, previous_action: bool) -> None:
    lengths = unequal(60)
    assert len(buckets(lengths)) > 1
    random = torch.Generator().manual_seed(0)
    observations = torch.randn(int(lengths.max()), 60, 3, generator=random)
    actions = torch.randint(4, (int(lengths.max()), 60, 1), generator=random).float()
    mask = torch.from_numpy(np.arange(lengths.max())[:, None] < lengths)[..., None]
    policy = RecurrentPolicy(
        3, Categorical([4]), PolicyConfig(core=core, init_range=0.5, previous_action=previous_action)
    )
    whole, _ = policy.remember(observations, actions=actions)
    parts = policy.unroll(observations, actions, lengths)
    torch.testing.assert_close(parts * mask, whole * mask)
    found = [torch.autograd.grad((f * mask).square().sum(), list(policy.core.parameters())[:3]) for f in (whole, parts)]
    for one, other in zip(*found, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-4)
