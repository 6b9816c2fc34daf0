"""What all action heads have in common."""

from __future__ import annotations

import pytest
import torch

from dpsearch.policies import Categorical, Deterministic, Gaussian, Head
from tests.support.numbers import SHAPE, normal, uniform


@pytest.mark.parametrize("head", [Categorical([4]), Categorical([2, 4, 3]), Categorical([1]), Gaussian(2)])
@pytest.mark.parametrize(("dtype", "error"), [(torch.float32, 2e-5), (torch.float64, 1e-12)])
def test_eligibilities_are_the_derivatives_of_the_log_probability(head: Head, dtype: torch.dtype, error: float) -> None:
    outputs = normal(*SHAPE, head.n_outputs)
    actions = head.sample(outputs, uniform(*SHAPE, head.draws))
    weights, bonus = normal(*SHAPE, seed=1), normal(*SHAPE, seed=2)
    outputs.requires_grad_()
    (expected,) = torch.autograd.grad(head.log_prob(outputs, actions), outputs, weights)
    (of_entropy,) = torch.autograd.grad(head.entropy(outputs), outputs, bonus)
    found, entropy = head.eligibilities(outputs.to(dtype), actions.to(dtype), weights.to(dtype))
    torch.testing.assert_close(found.double(), expected, rtol=error, atol=error)
    both, _ = head.eligibilities(outputs.to(dtype), actions.to(dtype), weights.to(dtype), bonus.to(dtype))
    torch.testing.assert_close(both.double(), expected + of_entropy, rtol=error, atol=error)
    torch.testing.assert_close(entropy.double(), head.entropy(outputs.detach()), rtol=error, atol=error)


def test_the_mode_is_what_is_most_probable() -> None:
    outputs = torch.tensor([[1.0, 3.0, 2.0, 0.0, 5.0]])
    assert Categorical([3, 2]).mode(outputs).tolist() == [[1, 1]]
    assert Gaussian(2).mode(outputs[:, :4]).tolist() == [[1.0, 3.0]]
    torch.testing.assert_close(Deterministic(5).mode(outputs), torch.tanh(outputs))


def test_only_a_gaussian_head_can_be_scaled_by_its_variance() -> None:
    for head in (Categorical([2]), Deterministic(2)):
        with pytest.raises(TypeError, match="Gaussian"):
            head.scaled_eligibilities(torch.zeros(1, 2), torch.zeros(1, 1), torch.ones(1))


def test_a_head_without_actions_is_refused() -> None:
    for sizes in ([], [0], [2, -1]):
        with pytest.raises(ValueError, match="categorical head"):
            Categorical(sizes)
    for head in (Gaussian, Deterministic):
        with pytest.raises(ValueError, match="at least one"):
            head(0)


def test_an_action_is_shown_one_hot_if_it_is_discrete_and_as_it_is_if_not() -> None:
    head = Categorical([2, 3])
    assert head.echo(torch.tensor([1.0, 2.0])).tolist() == [0, 1, 0, 0, 1]
    assert head.echo_size == 5
    assert Gaussian(2).echo(torch.tensor([0.3, -4.0])).tolist() == pytest.approx([0.3, -4.0])
    assert (Gaussian(2).echo_size, Deterministic(3).echo_size) == (2, 3)


@pytest.mark.parametrize("head", [Categorical([3, 2]), Gaussian(2)])
def test_fisher_information_is_the_covariance_of_the_score(head: Head) -> None:
    random = torch.Generator().manual_seed(3)
    outputs = torch.randn(head.n_outputs, generator=random, dtype=torch.float64)
    uniforms = torch.rand(400_000, head.draws, generator=random, dtype=torch.float64)
    many = outputs.expand(len(uniforms), -1)
    scores, _ = head.eligibilities(many, head.sample(many, uniforms), torch.ones(len(uniforms), dtype=torch.float64))
    covariance = scores.T @ scores / len(scores)
    information = torch.stack([head.fisher(outputs, e) for e in torch.eye(head.n_outputs, dtype=torch.float64)])
    torch.testing.assert_close(information, covariance, rtol=0.03, atol=0.03)
