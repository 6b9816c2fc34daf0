import numpy as np
import pytest
import torch
from scipy import stats
from torch.distributions import Categorical as TorchCategorical
from torch.distributions import Normal, kl_divergence

from dpsearch.policies import Categorical, Deterministic, Gaussian
from dpsearch.policies.heads import Head

SHAPE = (5, 3)  # time, episodes


def normal(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def uniform(*shape: int, seed: int = 0) -> torch.Tensor:
    words = np.random.default_rng(seed).integers(2**32, size=shape)
    return torch.from_numpy((words + 0.5) * 2.0**-32)


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


@pytest.mark.parametrize("outputs", [[1000.0, 0.0, -1000.0], [-3e38, -3e38, -3e38], [0.0, 30.0, 30.0]])
def test_eligibilities_of_a_softmax_are_finite_however_far_apart_its_outputs(outputs: list[float]) -> None:
    head, logits = Categorical([3]), torch.tensor([outputs])
    found, entropy = head.eligibilities(logits, torch.ones(1, 1), torch.ones(1))
    chosen = torch.tensor([0.0, 1.0, 0.0])
    torch.testing.assert_close(found[0], chosen - torch.softmax(logits[0].double(), 0).float())
    torch.testing.assert_close(entropy, head.entropy(logits.double()).float(), rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("head", [Categorical([4]), Categorical([2, 4, 3]), Categorical([1])])
@pytest.mark.parametrize("steps", [1, 40, 300])  # of three episodes: less than a block of steps, about one, and many
@pytest.mark.parametrize("bias", [True, False])
def test_backpropagating_through_a_layer_is_what_autograd_makes_of_it(
    head: Categorical, steps: int, bias: bool
) -> None:
    shape, layer = (steps, 3), torch.nn.Linear(6, head.n_outputs, bias=bias)
    features = normal(*shape, 6).float().requires_grad_()
    weights, bonus = normal(*shape, seed=1).float(), normal(*shape, seed=2).float()
    for extra in (None, bonus):
        outputs = layer(features)
        actions = head.sample(outputs.detach(), uniform(*shape, head.draws)).float()
        gain = (head.log_prob(outputs, actions) * weights).sum()
        if extra is not None:
            gain = gain + (head.entropy(outputs) * extra).sum()
        parameters = list(layer.parameters())
        expected = torch.autograd.grad(gain, [features, *parameters])
        *slopes, entropy = head.through_readout(
            (layer.weight, layer.bias),
            features,
            actions.numpy(),
            weights.numpy(),
            extra if extra is None else extra.numpy(),
        )
        for slope, gradient in zip(slopes, expected, strict=False):  # one by the bias comes in any case
            torch.testing.assert_close(torch.from_numpy(slope), gradient, rtol=1e-4, atol=1e-4)
        torch.testing.assert_close(torch.from_numpy(entropy), head.entropy(outputs.detach()), rtol=1e-5, atol=1e-5)


def test_actions_that_there_are_not_are_none_of_the_choices() -> None:
    for action in (-1.0, 2.0, np.nan):
        found, _ = Categorical([2]).eligibilities(torch.zeros(1, 2), torch.full((1, 1), action), torch.ones(1))
        assert found.tolist() == [[-0.5, -0.5]]


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


def test_sampled_numbers_have_the_normal_distribution() -> None:
    n = 20_000
    outputs = torch.tensor([0.5, -2.0, 0.0, 1.0], dtype=torch.float64)
    actions = Gaussian(2).sample(outputs.expand(n, 4), uniform(n, 4, seed=3)).numpy()
    for i in range(2):
        deviation = float(torch.sigmoid(outputs[2 + i]))
        assert stats.kstest(actions[:, i], stats.norm(float(outputs[i]), deviation).cdf).pvalue > 0.01
    assert abs(np.corrcoef(actions.T)[0, 1]) < 0.03


def test_the_mode_is_what_is_most_probable() -> None:
    outputs = torch.tensor([[1.0, 3.0, 2.0, 0.0, 5.0]])
    assert Categorical([3, 2]).mode(outputs).tolist() == [[1, 1]]
    assert Gaussian(2).mode(outputs[:, :4]).tolist() == [[1.0, 3.0]]
    torch.testing.assert_close(Deterministic(5).mode(outputs), torch.tanh(outputs))


def test_a_deterministic_head_has_no_probabilities() -> None:
    outputs = torch.zeros(1, 2)
    head = Deterministic(2)
    assert torch.equal(head.sample(outputs, torch.zeros(1, 0)), head.mode(outputs))
    with pytest.raises(TypeError, match="no log-probabilities"):
        head.log_prob(outputs, outputs)
    with pytest.raises(TypeError, match="no entropy"):
        head.entropy(outputs)
    with pytest.raises(TypeError, match="no entropy"):
        head.cross_entropy(outputs, outputs)


def test_scaled_by_their_variances_eligibilities_stay_finite_in_each_dimension() -> None:
    outputs = torch.tensor([[0.3, -0.2, -200.0, 0.0]])  # sigma = (0, 0.5)
    actions = outputs[..., :2] + torch.sigmoid(outputs[..., 2:])  # one sigma away
    scaled, _ = Gaussian(2).scaled_eligibilities(outputs, actions, torch.ones(1))
    torch.testing.assert_close(scaled, torch.tensor([[0.0, 0.5, 0.0, 0.0]]))  # of the means: a - mu


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


def test_squared_error_is_the_distance_of_the_probabilities_from_certainty() -> None:
    head, outputs = Categorical([2, 3]), normal(*SHAPE, 5)
    actions = head.sample(outputs, uniform(*SHAPE, 2))
    p = torch.cat([outputs[..., :2].softmax(-1), outputs[..., 2:].softmax(-1)], -1)
    torch.testing.assert_close(head.squared_error(outputs, actions), (head.echo(actions) - p).square().sum(-1))
    with pytest.raises(TypeError, match="discrete"):
        Gaussian(1).squared_error(torch.zeros(1, 2), torch.zeros(1, 1))


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
