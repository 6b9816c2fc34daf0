from collections.abc import Iterator

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dpsearch.kernels.lanes import LANES, WIDTH, noise_rows
from dpsearch.policies import Categorical, Deterministic, Gaussian, Head, RecurrentPolicy
from dpsearch.policies.compiled import compiled_policy
from dpsearch.policies.policy import Core

STEPS = 60
HEADS = [Categorical([4]), Categorical([2, 3, 5]), Gaussian(1), Gaussian(3), Deterministic(2)]
CORES: list[Core] = ["lstm", "rnn", "none"]


def random_weights(policy: RecurrentPolicy, seed: int, n: int = LANES) -> NDArray[np.float64]:
    return np.random.default_rng(seed).uniform(-0.7, 0.7, (n, len(policy.vector())))


def run_compiled(
    policy: RecurrentPolicy,
    weights: NDArray[np.float64],
    observations: NDArray[np.float64],
    greedy: bool = True,
    lanes: int = LANES,
) -> Iterator[NDArray[np.float64]]:
    """The outputs (LANES, n_outputs) at each step, for observations (T, LANES, O)."""
    compiled = policy.compiled()
    packed = compiled.pack(weights.T, greedy).T if weights.ndim == 2 else compiled.pack(weights, greedy)
    packed = np.ascontiguousarray(packed)
    hidden = np.zeros((compiled.hidden_rows, LANES), packed.dtype)
    scratch = np.full((compiled.scratch_rows, LANES), np.nan, packed.dtype)  # what it holds must not matter
    output = np.full((compiled.n_outputs, LANES), np.nan)
    for observation in observations:
        rows = np.ascontiguousarray(observation.T)
        compiled.forward(compiled.sizes, packed, rows, hidden, scratch, output, lanes)
        yield output.T.copy()


def run_torch(
    policy: RecurrentPolicy, weights: NDArray[np.float64], observations: NDArray[np.float64]
) -> NDArray[np.float64]:
    policy.load_vector(weights)
    with torch.no_grad():
        outputs, _ = policy(torch.from_numpy(observations).to(policy.readout.weight.dtype))
    result: NDArray[np.float64] = outputs.numpy().astype(np.float64)
    return result


@pytest.mark.parametrize("core", CORES)
@pytest.mark.parametrize("bias", [True, False])
@pytest.mark.parametrize("hidden_size", [1, 2, 10, 17])
def test_the_forward_pass_is_that_of_the_module(core: Core, bias: bool, hidden_size: int) -> None:
    for head in HEADS:
        policy = RecurrentPolicy(3, head, core=core, hidden_size=hidden_size, bias=bias).double()
        observations = np.random.default_rng(1).normal(size=(STEPS, LANES, 3))
        (weights,) = random_weights(policy, seed=2, n=1)
        outputs = np.stack(list(run_compiled(policy, weights, observations)))
        np.testing.assert_allclose(outputs, run_torch(policy, weights, observations), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("core", CORES)
@pytest.mark.parametrize("bias", [True, False])
@pytest.mark.parametrize("hidden_size", [2, 5])
def test_without_a_readout_the_first_units_are_the_outputs(core: Core, bias: bool, hidden_size: int) -> None:
    head = Deterministic(2, squash=False)
    policy = RecurrentPolicy(3, head, core=core, hidden_size=hidden_size, bias=bias, readout=False).double()
    assert len(policy.vector()) == sum(p.numel() for p in policy.core.parameters() if p.requires_grad)
    observations = np.random.default_rng(1).normal(size=(STEPS, LANES, 3))
    (weights,) = random_weights(policy, seed=2, n=1)
    outputs = np.stack(list(run_compiled(policy, weights, observations)))
    np.testing.assert_allclose(outputs, run_torch(policy, weights, observations), rtol=1e-12, atol=1e-12)
    features, _ = policy.remember(torch.from_numpy(observations))
    np.testing.assert_allclose(outputs, features[..., :2].detach(), rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(policy.head.mode(torch.from_numpy(outputs)), outputs)


@pytest.mark.parametrize("core", CORES)
@pytest.mark.parametrize("bias", [True, False])
@pytest.mark.parametrize("hidden_size", [1, 2, 10, 17])
def test_every_lane_can_have_weights_of_its_own(core: Core, bias: bool, hidden_size: int) -> None:
    policy = RecurrentPolicy(3, Gaussian(2), core=core, hidden_size=hidden_size, bias=bias).double()
    observations = np.random.default_rng(3).normal(size=(STEPS, LANES, 3))
    population = random_weights(policy, seed=4)
    outputs = np.stack(list(run_compiled(policy, np.ascontiguousarray(population.T), observations)))
    for lane, weights in enumerate(population):
        expected = run_torch(policy, weights, observations[:, lane : lane + 1])[:, 0]
        np.testing.assert_allclose(outputs[:, lane], expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("core", CORES)
@pytest.mark.parametrize("bias", [True, False])
@pytest.mark.parametrize("hidden_size", [1, 2, 10, 17])
@pytest.mark.parametrize("greedy", [True, False])
def test_in_single_precision_the_module_agrees_to_its_rounding(
    core: Core, bias: bool, hidden_size: int, greedy: bool
) -> None:
    policy = RecurrentPolicy(3, Categorical([4]), core=core, hidden_size=hidden_size, bias=bias)
    observations = np.random.default_rng(5).normal(size=(STEPS, LANES, 3))
    weights = random_weights(policy, seed=6, n=1)[0].astype(np.float32).astype(np.float64)
    outputs = np.stack(list(run_compiled(policy, weights, observations, greedy)))
    np.testing.assert_allclose(outputs, run_torch(policy, weights, observations), rtol=1e-5, atol=1e-5)


def test_only_one_policy_whose_actions_are_random_plays_in_single_precision() -> None:
    policy = RecurrentPolicy(3, Categorical([4]))
    compiled, vector = policy.compiled(), policy.vector()
    assert compiled.pack(vector, greedy=False).dtype == np.float32
    assert compiled.pack(vector, greedy=True).dtype == np.float64
    assert compiled.pack(vector[None], greedy=False).dtype == np.float64
    np.testing.assert_array_equal(compiled.pack(vector, greedy=False), compiled.pack(vector, greedy=True))
    steady = RecurrentPolicy(3, Deterministic(1))  # whose actions are not random, whether greedy or not
    assert steady.compiled().pack(steady.vector(), greedy=False).dtype == np.float64


@pytest.mark.parametrize("core", CORES)
def test_shared_weights_and_lanes_with_equal_weights_agree_bit_for_bit(core: Core) -> None:
    policy = RecurrentPolicy(3, Categorical([4]), core=core)
    observations = np.random.default_rng(7).normal(size=(STEPS, LANES, 3))
    (weights,) = random_weights(policy, seed=8, n=1)
    shared = run_compiled(policy, weights, observations)
    lanes = run_compiled(policy, np.repeat(weights[:, None], LANES, axis=1), observations)
    np.testing.assert_array_equal(list(shared), list(lanes))


@pytest.mark.parametrize("core", CORES)
@pytest.mark.parametrize("precision", ["single", "double", "own weights"])
def test_fewer_lanes_come_to_the_same_bit_for_bit(core: Core, precision: str) -> None:
    policy = RecurrentPolicy(3, Categorical([4]), core=core, previous_action=True, hidden_size=5)
    observations = np.random.default_rng(9).normal(size=(STEPS, LANES, 3))
    population = random_weights(policy, seed=10)
    weights = np.ascontiguousarray(population.T) if precision == "own weights" else population[0]
    every = np.stack(list(run_compiled(policy, weights, observations, precision != "single")))
    for lanes in range(WIDTH, LANES, WIDTH):
        some = np.stack(list(run_compiled(policy, weights, observations, precision != "single", lanes)))
        np.testing.assert_array_equal(some[:, :lanes], every[:, :lanes])


def choose(
    head: Head, outputs: NDArray[np.float64], uniforms: NDArray[np.float64] | None, lanes: int = LANES
) -> NDArray[np.float64]:
    """Compiled actions (LANES, A); greedy if there are no uniform numbers."""
    compiled = compiled_policy("none", 1, 1, head, True)
    noise = np.full((noise_rows(compiled.draws), LANES), 0.5)
    if uniforms is not None:
        noise[: compiled.draws] = uniforms.T
    action = np.full((compiled.action_size, LANES), np.nan)
    function = compiled.mode if uniforms is None else compiled.sample
    function(compiled.head_sizes, noise, np.ascontiguousarray(outputs.T), action, lanes)
    return action.T


@pytest.mark.parametrize("head", HEADS, ids=lambda head: f"{type(head).__name__}{head.n_outputs}")
def test_equal_uniform_numbers_pick_equal_actions(head: Head) -> None:
    rng = np.random.default_rng(9)
    for scale in (0.1, 1.0, 30.0):
        outputs = rng.normal(scale=scale, size=(LANES, head.n_outputs))
        uniforms = rng.uniform(1e-9, 1.0, (LANES, head.draws))
        expected = head.sample(torch.from_numpy(outputs), torch.from_numpy(uniforms)).numpy()
        np.testing.assert_allclose(choose(head, outputs, uniforms), expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("head", HEADS, ids=lambda head: f"{type(head).__name__}{head.n_outputs}")
def test_greedy_actions_are_equal(head: Head) -> None:
    outputs = np.random.default_rng(10).normal(size=(LANES, head.n_outputs))
    outputs[0] = 0.0  # a tie
    expected = head.mode(torch.from_numpy(outputs)).numpy()
    np.testing.assert_allclose(choose(head, outputs, None), expected, rtol=1e-13, atol=1e-15)


@pytest.mark.parametrize("head", HEADS, ids=lambda head: f"{type(head).__name__}{head.n_outputs}")
@pytest.mark.parametrize("greedy", [True, False])
def test_fewer_lanes_act_the_same(head: Head, greedy: bool) -> None:
    rng = np.random.default_rng(11)
    outputs = rng.normal(size=(LANES, head.n_outputs))
    uniforms = None if greedy else rng.uniform(1e-9, 1.0, (LANES, head.draws))
    every = choose(head, outputs, uniforms)
    for lanes in range(WIDTH, LANES, WIDTH):
        np.testing.assert_array_equal(choose(head, outputs, uniforms, lanes)[:lanes], every[:lanes])


def test_extreme_uniform_numbers_pick_actions_that_exist() -> None:
    for u in (0.5 * 2.0**-32, 1.0 - 0.5 * 2.0**-32):
        uniforms = np.full((LANES, 2), u)
        picks = choose(Categorical([3, 2]), np.full((LANES, 5), -800.0), uniforms)
        np.testing.assert_array_equal(picks, np.tile([2.0, 1.0] if u > 0.5 else [0.0, 0.0], (LANES, 1)))
        assert np.isfinite(choose(Gaussian(1), np.zeros((LANES, 2)), uniforms)).all()


def test_a_head_without_a_compiled_twin_is_refused() -> None:
    class Unknown(Head):
        n_outputs = action_size = draws = 1

        def log_prob(self, outputs: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
            return outputs

        def entropy(self, outputs: torch.Tensor) -> torch.Tensor:
            return outputs

        def cross_entropy(self, before: torch.Tensor, outputs: torch.Tensor) -> torch.Tensor:
            return outputs

        def sample(self, outputs: torch.Tensor, uniforms: torch.Tensor) -> torch.Tensor:
            return outputs

        def mode(self, outputs: torch.Tensor) -> torch.Tensor:
            return outputs

    with pytest.raises(TypeError, match="no compiled sampling for a Unknown head"):
        compiled_policy("none", 1, 1, Unknown(), True)
