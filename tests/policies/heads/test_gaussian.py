"""The Gaussian head, against torch.distributions and the moments of its samples."""

from __future__ import annotations

import numpy as np
import torch
from scipy import stats
from torch.distributions import Normal, kl_divergence

from dpsearch.policies import Gaussian
from tests.support.numbers import SHAPE, normal, uniform


def test_a_gaussian_head_has_a_linear_mean_and_a_sigmoid_deviation() -> None:
    head = Gaussian(2)
    outputs = normal(*SHAPE, 4)
    twin = Normal(outputs[..., :2], torch.sigmoid(outputs[..., 2:]))
    actions = head.sample(outputs, uniform(*SHAPE, 4))
    torch.testing.assert_close(head.log_prob(outputs, actions), twin.log_prob(actions).sum(-1))
    torch.testing.assert_close(head.entropy(outputs), twin.entropy().sum(-1))
    before = normal(*SHAPE, 4, seed=1)
    other = Normal(before[..., :2], torch.sigmoid(before[..., 2:]))
    crossed = other.entropy() + kl_divergence(other, twin)
    torch.testing.assert_close(head.cross_entropy(before, outputs), crossed.sum(-1))


def test_scaled_eligibilities_are_the_others_times_the_variance() -> None:
    head, outputs, weights = Gaussian(2), normal(*SHAPE, 4), normal(*SHAPE, seed=1)
    actions = head.sample(outputs, uniform(*SHAPE, 4))
    variance = torch.sigmoid(outputs[..., 2:]).square()
    for bonus in (None, normal(*SHAPE, seed=2)):
        scaled, entropy = head.scaled_eligibilities(outputs, actions, weights, bonus)
        plain, _ = head.eligibilities(outputs, actions, weights, bonus)
        torch.testing.assert_close(scaled, plain * torch.cat((variance, variance), -1))
    torch.testing.assert_close(entropy, head.entropy(outputs))


def test_a_gaussian_log_probability_is_finite_where_the_deviation_underflows() -> None:
    outputs = torch.tensor([[0.0, -80.0]])
    assert torch.isfinite(Gaussian(1).log_prob(outputs, torch.zeros(1, 1))).all()
    assert torch.isfinite(Gaussian(1).entropy(outputs)).all()


def test_sampled_numbers_have_the_normal_distribution() -> None:
    n = 20_000
    outputs = torch.tensor([0.5, -2.0, 0.0, 1.0], dtype=torch.float64)
    actions = Gaussian(2).sample(outputs.expand(n, 4), uniform(n, 4, seed=3)).numpy()
    for i in range(2):
        deviation = float(torch.sigmoid(outputs[2 + i]))
        assert stats.kstest(actions[:, i], stats.norm(float(outputs[i]), deviation).cdf).pvalue > 0.01
    assert abs(np.corrcoef(actions.T)[0, 1]) < 0.03


def test_scaled_by_their_variances_eligibilities_stay_finite_in_each_dimension() -> None:
    outputs = torch.tensor([[0.3, -0.2, -200.0, 0.0]])  # sigma = (0, 0.5)
    actions = outputs[..., :2] + torch.sigmoid(outputs[..., 2:])  # one sigma away
    scaled, _ = Gaussian(2).scaled_eligibilities(outputs, actions, torch.ones(1))
    torch.testing.assert_close(scaled, torch.tensor([[0.0, 0.5, 0.0, 0.0]]))  # of the means: a - mu
