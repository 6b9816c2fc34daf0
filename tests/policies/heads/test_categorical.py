"""The softmax head, against torch.distributions and the frequencies of its samples."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy import stats
from torch.distributions import Categorical as TorchCategorical
from torch.distributions import kl_divergence

from dpsearch.policies import Categorical, Gaussian, Head
from tests.support.numbers import SHAPE, normal, uniform


def test_a_categorical_head_is_a_product_of_softmax_distributions() -> None:
    head = Categorical([2, 4, 3])
    outputs = normal(*SHAPE, 9)
    twins = [TorchCategorical(logits=logits) for logits in outputs.split([2, 4, 3], dim=-1)]
    actions = head.sample(outputs, uniform(*SHAPE, 3))
    expected = sum(twin.log_prob(actions[..., i]) for i, twin in enumerate(twins))
    torch.testing.assert_close(head.log_prob(outputs, actions), expected)
    torch.testing.assert_close(head.entropy(outputs), sum(twin.entropy() for twin in twins))
    others = [TorchCategorical(logits=logits) for logits in normal(*SHAPE, 9, seed=1).split([2, 4, 3], dim=-1)]
    crossed = sum(q.entropy() + kl_divergence(q, p) for q, p in zip(others, twins, strict=True))
    torch.testing.assert_close(head.cross_entropy(normal(*SHAPE, 9, seed=1), outputs), crossed)


def test_what_is_put_together_once_is_the_loss_of_imitating_categories() -> None:
    head = Categorical([2, 4, 3])
    outputs = normal(*SHAPE, 9).requires_grad_()
    actions = head.sample(outputs.detach(), uniform(*SHAPE, 3)).float()
    arguments = actions, uniform(*SHAPE), normal(*SHAPE, 9, seed=1), 0.7 * torch.ones(SHAPE)
    losses, expected = head.imitation_loss(*arguments)(outputs), Head.imitation_loss(head, *arguments)(outputs)
    torch.testing.assert_close(losses, expected)
    slopes = [torch.autograd.grad(each.sum(), outputs)[0] for each in (losses, expected)]
    torch.testing.assert_close(*slopes)


def test_actions_may_come_as_floats_as_rollouts_record_them() -> None:
    head = Categorical([3])
    outputs = normal(*SHAPE, 3)
    actions = torch.ones(*SHAPE, 1)
    torch.testing.assert_close(head.log_prob(outputs, actions), torch.log_softmax(outputs, -1)[..., 1])


def test_sampled_choices_have_the_probabilities_of_the_softmax() -> None:
    n = 20_000
    outputs = torch.tensor([0.3, -1.0, 1.5, 0.0, -3.0], dtype=torch.float64)
    picks = Categorical([5]).sample(outputs.expand(n, 5), uniform(n, 1, seed=1))[:, 0]
    observed = np.bincount(picks.numpy(), minlength=5)
    assert stats.chisquare(observed, n * torch.softmax(outputs, -1).numpy()).pvalue > 0.01


def test_choices_of_different_groups_are_independent() -> None:
    n = 20_000
    picks = Categorical([2, 3]).sample(torch.zeros(n, 5), uniform(n, 2, seed=2)).numpy()
    table = np.histogram2d(picks[:, 0], picks[:, 1], bins=(2, 3))[0]
    assert stats.chisquare(table.ravel()).pvalue > 0.01


def test_squared_error_is_the_distance_of_the_probabilities_from_certainty() -> None:
    head, outputs = Categorical([2, 3]), normal(*SHAPE, 5)
    actions = head.sample(outputs, uniform(*SHAPE, 2))
    p = torch.cat([outputs[..., :2].softmax(-1), outputs[..., 2:].softmax(-1)], -1)
    torch.testing.assert_close(head.squared_error(outputs, actions), (head.echo(actions) - p).square().sum(-1))
    with pytest.raises(TypeError, match="discrete"):
        Gaussian(1).squared_error(torch.zeros(1, 2), torch.zeros(1, 1))
