"""Each core is torch's layer of that name, without redundant parameters, and starts as it is told to."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from dpsearch.policies import CORES, Categorical, Core, Gaussian, PolicyConfig, RecurrentPolicy

INPUTS, UNITS = 3, 5
LAYERS = {"lstm": nn.LSTM, "gru": nn.GRU, "elman": nn.RNN}


def random_core(name: str, bias: bool) -> Core:
    core = CORES[name](INPUTS, UNITS, bias).double()
    added = {"forget_bias": 0.0, "input_bias": 0.0}
    core.initialise(torch.Generator().manual_seed(1), 1.0, added)
    return core


def inputs(steps: int = 7, episodes: int = 4) -> Tensor:
    return torch.randn(steps, episodes, INPUTS, generator=torch.Generator().manual_seed(2), dtype=torch.float64)


def layer_of(name: str, core: Core) -> nn.LSTM | nn.GRU | nn.RNN:
    """The layer of torch with the core's weights."""
    layer: nn.LSTM | nn.GRU | nn.RNN = LAYERS[name](INPUTS, UNITS, bias=core.bias is not None)
    layer.double()
    for parameter, weights in zip(layer.parameters(), core.torch_weights(), strict=True):
        parameter.data.copy_(weights)
    return layer


@pytest.mark.parametrize("name", LAYERS)
@pytest.mark.parametrize("bias", [True, False])
def test_a_recurrent_core_is_the_layer_of_torch(name: str, bias: bool) -> None:
    core = random_core(name, bias)
    layer = layer_of(name, core)
    state = torch.randn(4, core.state_size, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    for before in (core.start(inputs()), core.start(inputs(), state)):
        features, after = core(inputs(), before)
        expected, last = layer(inputs(), before if name == "lstm" else before[0])
        torch.testing.assert_close(features, expected)
        torch.testing.assert_close(torch.cat(after), torch.cat(last) if name == "lstm" else last)


@pytest.mark.parametrize("name", LAYERS)
def test_its_gradient_is_that_of_the_layer_of_torch(name: str) -> None:
    core = random_core(name, bias=True)
    layer = layer_of(name, core)
    core(inputs(), core.start(inputs()))[0].square().sum().backward()
    layer(inputs())[0].square().sum().backward()
    theirs = [parameter.grad for parameter in layer.parameters()]
    expected = dict(zip(("weight_ih", "weight_hh", "bias"), theirs, strict=False))
    if name == "gru":
        assert theirs[3] is not None
        expected["bias_hn"] = theirs[3][2 * UNITS :]
    assert expected.keys() == dict(core.named_parameters()).keys()
    for parameter, gradient in expected.items():
        torch.testing.assert_close(core.get_parameter(parameter).grad, gradient)


@pytest.mark.parametrize("bias", [True, False])
def test_without_memory_there_is_a_layer_of_tanh_units(bias: bool) -> None:
    core = random_core("none", bias)
    features, after = core(inputs(), core.start(inputs()))
    torch.testing.assert_close(features, torch.tanh(nn.functional.linear(inputs(), core.weight_ih, core.bias)))
    assert after == ()


@pytest.mark.parametrize("name", CORES)
@pytest.mark.parametrize("bias", [True, False])
def test_no_parameter_is_redundant(name: str, bias: bool) -> None:
    core = random_core(name, bias)
    features = core(inputs(40, 30), core.start(inputs(40, 30)))[0].reshape(-1)
    random = torch.randn(4 * sum(p.numel() for p in core.parameters()), len(features), dtype=torch.float64)
    rows = [
        torch.cat([g.reshape(-1) for g in torch.autograd.grad(features, list(core.parameters()), v, retain_graph=True)])
        for v in random
    ]
    assert torch.linalg.matrix_rank(torch.stack(rows), rtol=1e-9) == sum(p.numel() for p in core.parameters())


@pytest.mark.parametrize("name", CORES)
@pytest.mark.parametrize("bias", [True, False])
def test_the_compiled_twin_reads_every_weight_once(name: str, bias: bool) -> None:
    policy = RecurrentPolicy(INPUTS, Gaussian(2), PolicyConfig(core=name, hidden_size=UNITS, bias=bias))
    np.testing.assert_array_equal(np.sort(policy.compiled().order), np.arange(len(policy.vector())))


@pytest.mark.parametrize(
    ("name", "blocks"), [("lstm", {"forget_bias": 1, "input_bias": 0}), ("gru", {"forget_bias": 1})]
)
def test_gate_biases_are_added_to_the_initial_ones_of_those_gates_alone(name: str, blocks: dict[str, int]) -> None:
    added: dict[str, Any] = {setting: 7.0 - 2.0 * k for k, setting in enumerate(blocks)}
    config = PolicyConfig(core=name, hidden_size=UNITS)
    plain, biased = (
        RecurrentPolicy(3, Categorical([4]), replace(config, **options), seed=1) for options in ({}, added)
    )
    assert plain.core.bias is not None
    assert biased.core.bias is not None
    expected = torch.zeros(CORES[name].blocks, UNITS)  # in torch's order of gates
    for setting, block in blocks.items():
        expected[block] = added[setting]
    torch.testing.assert_close((biased.core.bias - plain.core.bias).reshape(-1, UNITS), expected)
    assert np.count_nonzero(biased.vector() - plain.vector()) == UNITS * len(blocks)


@pytest.mark.parametrize("name", [name for name, kind in CORES.items() if "forget_bias" in kind.gate_biases])
def test_a_forget_bias_makes_a_fresh_memory_last(name: str) -> None:
    def trace(forget_bias: float) -> float:
        policy = RecurrentPolicy(1, Gaussian(1), PolicyConfig(core=name, forget_bias=forget_bias))
        with torch.no_grad():
            _, quiet = policy(torch.zeros(50, 1, 1))
            _, kicked = policy(torch.zeros(50, 1, 1), torch.ones(1, policy.state_size))
        return float((kicked - quiet)[0, -policy.hidden_size :].max())

    assert trace(0.0) < 1e-6
    assert trace(7.0) > 0.9


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"core": "elman", "forget_bias": 1.0}, "forget_bias needs core lstm or gru, with biases, got core elman"),
        ({"core": "gru", "input_bias": 1.0}, "input_bias needs core lstm, with biases, got core gru"),
        ({"core": "gru", "forget_bias": 1.0, "bias": False}, "forget_bias needs core lstm or gru, with biases"),
        ({"core": "rnn"}, "core must be one of lstm, gru, elman, none, got 'rnn'"),
    ],
)
def test_a_core_that_does_not_fit_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PolicyConfig(**options)  # type: ignore[arg-type]
