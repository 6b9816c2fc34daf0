"""The compiled gradient of a softmax, against autograd."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dpsearch.policies import Categorical
from tests.support.numbers import normal, uniform


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
