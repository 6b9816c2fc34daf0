"""The optimisers, where they are not simply torch's."""

from __future__ import annotations

import torch
from torch import nn

from dpsearch.algos.optimizers import GradientDescent, make_optimizer


def parameters() -> list[nn.Parameter]:
    generator = torch.Generator().manual_seed(0)
    made = [nn.Parameter(torch.randn(shape, generator=generator)) for shape in ((4, 3), (4,), (2, 2))]
    for parameter in made[:2]:  # nothing to learn for the last
        parameter.grad = torch.randn(parameter.shape, generator=generator)
    return made


def test_gradient_descent_is_torchs_own_without_options_bit_for_bit() -> None:
    ours, theirs = parameters(), parameters()
    quick, own = make_optimizer("SGD", ours, 0.3, {}), torch.optim.SGD(theirs, lr=0.3)
    assert isinstance(quick, GradientDescent)
    assert type(make_optimizer("SGD", ours, 0.3, {"momentum": 0.9})) is torch.optim.SGD
    for rate in (0.3, 0.1):
        quick.param_groups[0]["lr"] = own.param_groups[0]["lr"] = rate
        quick.step()
        own.step()
    assert all(torch.equal(a, b) for a, b in zip(ours, theirs, strict=True))
    assert quick.state_dict() == own.state_dict()
    quick.load_state_dict(own.state_dict())
