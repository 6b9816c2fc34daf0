"""Each core's compiled step agrees with its torch module to rounding."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dpsearch.kernels.lanes import LANES, WIDTH
from dpsearch.policies import (
    CORES,
    Categorical,
    Deterministic,
    Gaussian,
    PolicyConfig,
    RecurrentPolicy,
)
from dpsearch.policies.compiled import remember_action
from tests.support.twins import random_weights, run_compiled, run_torch

STEPS = 60
HEADS = [Categorical([4]), Categorical([2, 3, 5]), Gaussian(1), Gaussian(3), Deterministic(2)]
every_core = pytest.mark.parametrize("core", list(CORES))


@every_core
@pytest.mark.parametrize("bias", [True, False])
@pytest.mark.parametrize("hidden_size", [1, 2, 10, 17])
def test_the_forward_pass_is_that_of_the_module(core: str, bias: bool, hidden_size: int) -> None:
    for head in HEADS:
        policy = RecurrentPolicy(3, head, PolicyConfig(core=core, hidden_size=hidden_size, bias=bias)).double()
        observations = np.random.default_rng(1).normal(size=(STEPS, LANES, 3))
        (weights,) = random_weights(policy, seed=2, n=1)
        outputs = np.stack(list(run_compiled(policy, weights, observations)))
        np.testing.assert_allclose(outputs, run_torch(policy, weights, observations), rtol=1e-12, atol=1e-12)


@every_core
@settings(max_examples=40, deadline=None)
@given(
    observation_size=st.integers(1, 6),
    hidden_size=st.integers(3, 12),
    bias=st.booleans(),
    readout=st.booleans(),
    previous_action=st.booleans(),
    noise_memory=st.sampled_from([0.0, 0.8]),
    seed=st.integers(0, 2**32 - 1),
)
def test_step_by_step_it_acts_as_the_module_with_every_combination_of_settings(
    core: str,
    observation_size: int,
    hidden_size: int,
    bias: bool,
    readout: bool,
    previous_action: bool,
    noise_memory: float,
    seed: int,
) -> None:
    head = Gaussian(1) if noise_memory else Deterministic(2, squash=readout)
    policy = RecurrentPolicy(
        observation_size,
        head,
        PolicyConfig(
            core=core,
            hidden_size=hidden_size,
            bias=bias,
            readout=readout or noise_memory > 0.0,
            previous_action=previous_action,
            noise_memory=noise_memory,
        ),
    ).double()
    random = np.random.default_rng(seed)
    weights = random.uniform(-1.5, 1.5, len(policy.vector()))
    policy.load_vector(weights)
    compiled = policy.compiled()
    packed = compiled.pack(weights, greedy=True)
    hidden = np.zeros((compiled.hidden_rows, LANES))
    scratch, output = np.full((compiled.scratch_rows, LANES), np.nan), np.full((compiled.n_outputs, LANES), np.nan)
    state = torch.zeros(LANES, policy.state_size, dtype=torch.float64)
    for _ in range(10):
        observation, actions = (
            random.normal(size=(LANES, observation_size)),
            random.normal(size=(LANES, head.action_size)),
        )
        rows, taken = np.ascontiguousarray(observation.T), np.ascontiguousarray(actions.T)
        compiled.forward(compiled.sizes, packed, rows, hidden, scratch, output, LANES)
        remember_action(compiled.sizes, compiled.head_sizes, output, taken, hidden)
        with torch.no_grad():
            expected, state = policy(torch.from_numpy(observation[None]), state, torch.from_numpy(actions[None]))
        np.testing.assert_allclose(output[: head.n_outputs].T, expected[0].numpy(), rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(hidden.T, state.numpy(), rtol=1e-11, atol=1e-11)


@every_core
@pytest.mark.parametrize("bias", [True, False])
@pytest.mark.parametrize("hidden_size", [2, 5])
def test_without_a_readout_the_first_units_are_the_outputs(core: str, bias: bool, hidden_size: int) -> None:
    head = Deterministic(2, squash=False)
    config = PolicyConfig(core=core, hidden_size=hidden_size, bias=bias, readout=False)
    policy = RecurrentPolicy(3, head, config).double()
    assert len(policy.vector()) == sum(p.numel() for p in policy.core.parameters())
    observations = np.random.default_rng(1).normal(size=(STEPS, LANES, 3))
    (weights,) = random_weights(policy, seed=2, n=1)
    outputs = np.stack(list(run_compiled(policy, weights, observations)))
    np.testing.assert_allclose(outputs, run_torch(policy, weights, observations), rtol=1e-12, atol=1e-12)
    features, _ = policy.remember(torch.from_numpy(observations))
    np.testing.assert_allclose(outputs, features[..., :2].detach(), rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(policy.head.mode(torch.from_numpy(outputs)), outputs)


@every_core
@pytest.mark.parametrize("bias", [True, False])
@pytest.mark.parametrize("hidden_size", [1, 2, 10, 17])
def test_every_lane_can_have_weights_of_its_own(core: str, bias: bool, hidden_size: int) -> None:
    policy = RecurrentPolicy(3, Gaussian(2), PolicyConfig(core=core, hidden_size=hidden_size, bias=bias)).double()
    observations = np.random.default_rng(3).normal(size=(STEPS, LANES, 3))
    population = random_weights(policy, seed=4)
    outputs = np.stack(list(run_compiled(policy, np.ascontiguousarray(population.T), observations)))
    for lane, weights in enumerate(population):
        expected = run_torch(policy, weights, observations[:, lane : lane + 1])[:, 0]
        np.testing.assert_allclose(outputs[:, lane], expected, rtol=1e-12, atol=1e-12)


@every_core
@pytest.mark.parametrize("bias", [True, False])
@pytest.mark.parametrize("hidden_size", [1, 2, 10, 17])
@pytest.mark.parametrize("greedy", [True, False])
def test_in_single_precision_the_module_agrees_to_its_rounding(
    core: str, bias: bool, hidden_size: int, greedy: bool
) -> None:
    policy = RecurrentPolicy(3, Categorical([4]), PolicyConfig(core=core, hidden_size=hidden_size, bias=bias))
    observations = np.random.default_rng(5).normal(size=(STEPS, LANES, 3))
    weights = random_weights(policy, seed=6, n=1)[0].astype(np.float32).astype(np.float64)
    outputs = np.stack(list(run_compiled(policy, weights, observations, greedy)))
    np.testing.assert_allclose(outputs, run_torch(policy, weights, observations), rtol=1e-5, atol=1e-5)


@every_core
def test_shared_weights_and_lanes_with_equal_weights_agree_bit_for_bit(core: str) -> None:
    policy = RecurrentPolicy(3, Categorical([4]), PolicyConfig(core=core))
    observations = np.random.default_rng(7).normal(size=(STEPS, LANES, 3))
    (weights,) = random_weights(policy, seed=8, n=1)
    shared = run_compiled(policy, weights, observations)
    lanes = run_compiled(policy, np.repeat(weights[:, None], LANES, axis=1), observations)
    np.testing.assert_array_equal(list(shared), list(lanes))


@every_core
@pytest.mark.parametrize("precision", ["single", "double", "own weights"])
def test_fewer_lanes_come_to_the_same_bit_for_bit(core: str, precision: str) -> None:
    policy = RecurrentPolicy(3, Categorical([4]), PolicyConfig(core=core, previous_action=True, hidden_size=5))
    observations = np.random.default_rng(9).normal(size=(STEPS, LANES, 3))
    population = random_weights(policy, seed=10)
    weights = np.ascontiguousarray(population.T) if precision == "own weights" else population[0]
    every = np.stack(list(run_compiled(policy, weights, observations, precision != "single")))
    for lanes in range(WIDTH, LANES, WIDTH):
        some = np.stack(list(run_compiled(policy, weights, observations, precision != "single", lanes)))
        np.testing.assert_array_equal(some[:, :lanes], every[:, :lanes])
