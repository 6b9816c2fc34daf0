import copy
import pickle

import numpy as np
import pytest
import torch
from gymnasium import spaces
from scipy import stats

from dpsearch.policies import (
    CORES,
    Categorical,
    Deterministic,
    Gaussian,
    PolicyConfig,
    RecurrentPolicy,
    UnsupportedSpaceError,
)


@pytest.mark.parametrize("core", list(CORES))
@pytest.mark.parametrize("bias", [True, False])
def test_a_vector_that_is_loaded_comes_back(core: str, bias: bool) -> None:
    policy = RecurrentPolicy(3, Gaussian(2), PolicyConfig(core=core, hidden_size=4, bias=bias))
    vector = np.random.default_rng(0).normal(size=len(policy.vector())).astype(np.float32)
    policy.load_vector(vector)
    assert policy.vector().dtype == np.float64
    np.testing.assert_array_equal(policy.vector(), vector)


def test_the_vector_has_the_free_parameters_and_no_others() -> None:
    def count(core: str, bias: bool = True) -> int:
        config = PolicyConfig(core=core, hidden_size=5, bias=bias)
        return len(RecurrentPolicy(3, Categorical([4]), config).vector())

    assert count("lstm") == 4 * 5 * (3 + 5 + 1) + 4 * (5 + 1)  # one bias for each gate, not two
    assert count("lstm", bias=False) == 4 * 5 * 8 + 4 * 5
    assert count("gru") == 3 * 5 * (3 + 5 + 1) + 5 + 4 * (5 + 1)  # and one more inside the reset gate
    assert count("gru", bias=False) == 3 * 5 * 8 + 4 * 5
    assert count("elman") == 5 * (3 + 5 + 1) + 4 * 6
    assert count("none") == 5 * 4 + 4 * 6


def test_the_vector_is_a_copy() -> None:
    policy = RecurrentPolicy(3, Categorical([4]))
    policy.vector()[:] = 7.0
    assert policy.vector().max() < 1.0


def test_the_vector_is_that_of_the_weights_as_they_are_now() -> None:
    policy = RecurrentPolicy(3, Categorical([4]))
    before = policy.vector()
    twin, sent = copy.deepcopy(policy), pickle.loads(pickle.dumps(policy))  # both after a look at the weights
    with torch.no_grad():
        policy.readout.weight += 1.0
    assert (policy.vector() - before).sum() == pytest.approx(policy.readout.weight.numel(), rel=1e-5)
    for other in (twin, sent):
        np.testing.assert_array_equal(other.vector(), before)
        other.load_vector(before + 1.0)
        np.testing.assert_allclose(other.vector(), before + 1.0, rtol=1e-6)
    np.testing.assert_array_equal(twin.double().vector(), sent.vector())
    twin.load_vector(before)
    np.testing.assert_array_equal(twin.vector(), before)


def test_a_vector_that_does_not_fit_is_refused() -> None:
    policy = RecurrentPolicy(3, Categorical([4]))
    before = policy.vector()
    with pytest.raises(ValueError, match=rf"{len(before)} free parameters"):
        policy.load_vector(before[:-1])
    with pytest.raises(ValueError, match="NaN or infinite"):
        policy.load_vector(np.where(np.arange(len(before)) == 3, np.nan, before))
    np.testing.assert_array_equal(policy.vector(), before)


@pytest.mark.parametrize("core", list(CORES))
def test_playing_step_by_step_is_the_forward_pass_over_the_episode(core: str) -> None:
    policy = RecurrentPolicy(3, Gaussian(2), PolicyConfig(core=core, hidden_size=4, init_range=1.0))
    observations = torch.randn(7, 5, 3, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        outputs, last = policy(observations)
    state = None
    for t, observation in enumerate(observations):
        action, state = policy.act(observation, state)
        torch.testing.assert_close(action, policy.head.mode(outputs[t]))
        assert state.shape == (5, policy.state_size)
    torch.testing.assert_close(state, last)


def test_an_episode_can_go_on_from_a_state() -> None:
    policy = RecurrentPolicy(3, Gaussian(2), PolicyConfig(hidden_size=4, init_range=1.0))
    observations = torch.randn(7, 5, 3, generator=torch.Generator().manual_seed(0))
    with torch.no_grad():
        whole, last = policy(observations)
        first, between = policy(observations[:3])
        second, end = policy(observations[3:], between)
    torch.testing.assert_close(torch.cat((first, second)), whole)
    torch.testing.assert_close(end, last)


def test_weights_start_in_the_range_and_depend_on_the_seed_alone() -> None:
    vectors = [RecurrentPolicy(3, Categorical([4]), PolicyConfig(init_range=0.01), seed=s).vector() for s in (1, 1, 2)]
    np.testing.assert_array_equal(vectors[0], vectors[1])
    assert not np.array_equal(vectors[0], vectors[2])
    assert 0.009 < np.abs(vectors[0]).max() <= 0.01
    assert stats.kstest(vectors[0], stats.uniform(-0.01, 0.02).cdf).pvalue > 0.01


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"core": "bogus"}, "core must be one of"),
        ({"hidden_size": 0}, "hidden_size must be at least 1"),
        ({"init_range": -1.0}, "init_range must be finite and at least 0"),
        ({"init_range": float("nan")}, "init_range must be finite and at least 0"),
        ({"forget_bias": float("inf")}, "forget_bias must be finite"),
        ({"input_bias": float("nan")}, "input_bias must be finite"),
    ],
)
def test_an_impossible_architecture_is_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        RecurrentPolicy(3, Categorical([4]), PolicyConfig(**options))  # type: ignore[arg-type]


def test_a_policy_is_made_to_measure_for_its_spaces() -> None:
    policy = RecurrentPolicy.for_spaces(
        spaces.Dict(a=spaces.Box(-1, 1, (2, 3)), b=spaces.Discrete(4)),
        spaces.MultiDiscrete([2, 5]),
        PolicyConfig(core="elman", hidden_size=6),
    )
    assert (policy.observation_size, policy.head.n_outputs, policy.state_size) == (10, 7, 6)
    box = spaces.Box(-1, 1, (3,))
    assert isinstance(RecurrentPolicy.for_spaces(box, box).head, Gaussian)
    assert isinstance(RecurrentPolicy.for_spaces(box, box, deterministic=True).head, Deterministic)
    with pytest.raises(UnsupportedSpaceError, match="action space"):
        RecurrentPolicy.for_spaces(box, spaces.MultiBinary(2))


def test_a_policy_can_be_built_again_from_its_settings() -> None:
    policy = RecurrentPolicy(3, Categorical([4]), PolicyConfig(core="lstm", hidden_size=7, forget_bias=3.0), seed=5)
    twin = RecurrentPolicy(3, Categorical([4]), PolicyConfig(**policy.config()), seed=5)
    np.testing.assert_array_equal(policy.vector(), twin.vector())


@pytest.mark.parametrize("std", [0.1, 0.3])
def test_a_gaussian_policy_starts_with_the_deviation_asked_for(std: float) -> None:
    policy = RecurrentPolicy(3, Gaussian(2), PolicyConfig(init_std=std, init_range=0.001))
    outputs, _ = policy(torch.zeros(4, 1, 3))
    torch.testing.assert_close(torch.sigmoid(outputs[..., 2:]), torch.full((4, 1, 2), std), rtol=1e-2, atol=0.0)


@pytest.mark.parametrize("std", [0.0, 1.0, -0.1])
def test_a_deviation_that_cannot_be_is_refused(std: float) -> None:
    with pytest.raises(ValueError, match="init_std must be in"):
        RecurrentPolicy(3, Gaussian(1), PolicyConfig(init_std=std))


def test_a_softmax_has_no_deviation_to_start_with() -> None:
    with pytest.raises(ValueError, match="init_std must be null unless the policy is Gaussian"):
        RecurrentPolicy(3, Categorical([2]), PolicyConfig(init_std=0.3))
