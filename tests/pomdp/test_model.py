from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from dpsearch.env_kit import KernelEnv, KernelVectorEnv
from dpsearch.kernels.lanes import LANES, noise_rows
from dpsearch.kernels.philox import ENVIRONMENT, draw, stream_key
from dpsearch.pomdp import TabularPOMDP
from dpsearch.pomdp.distributions import Distributions
from dpsearch.pomdp.kernel import tabular_kernel
from dpsearch.pomdp.task import tabular_task

# A model small enough to break: two states, two actions, three symbols.
SMALL: dict[str, Any] = {
    "transitions": [[[0.9, 0.1], [0.0, 1.0]], [[0.5, 0.5], [1.0, 0.0]]],
    "observations": [[[1, 0, 0], [0, 0.5, 0.5]], [[0, 1, 0], [0, 0, 1]]],
    "rewards": [[[0.0, 1.0], [2.0, 3.0]], [[4.0, 5.0], [6.0, 7.0]]],
    "start": [0.25, 0.75],
}


def small(**changes: Any) -> TabularPOMDP:
    return TabularPOMDP.from_dense(**{**SMALL, **changes})


def choose(probabilities: NDArray[np.float64], uniform: float) -> int:
    """Inverse of the cumulative distribution, the slow way."""
    total = 0.0
    outcomes = np.flatnonzero(probabilities)
    for outcome in outcomes[:-1]:
        total += probabilities[outcome]
        if uniform < total:
            return int(outcome)
    return int(outcomes[-1])


def test_the_kernel_plays_the_dense_tables(noisy_pomdp: TabularPOMDP) -> None:
    """A twin that knows only the dense views, fed with the same random numbers, plays the same episodes."""
    model, actions = noisy_pomdp, np.random.default_rng(3).integers(3, size=25)
    move = [model.transition_matrix(a) for a in range(model.n_actions)]
    see = [model.observation_matrix(a) for a in range(model.n_actions)]
    env = KernelEnv(tabular_task(model, 25))
    noise = np.empty((noise_rows(2), LANES))
    for seed in range(40):
        observation, info = env.reset(seed=seed)

        def numbers(step: int, seed: int = seed) -> tuple[float, float]:
            episode = np.zeros(LANES, np.uint64)
            draw(np.uint64(stream_key(seed)), episode, np.full(LANES, step), ENVIRONMENT, noise, LANES)
            return noise[0, 0], noise[1, 0]

        first, second = numbers(0)
        state = choose(model.start_distribution(), first)
        symbol = choose(model.first_observation_matrix()[state], second)
        for t, action in enumerate(actions, start=1):
            assert info["state"] == state
            assert (observation == model.features[symbol].astype(np.float32)).all()
            first, second = numbers(t)
            state = choose(move[action][state], first)
            symbol = choose(see[action][state], second)
            observation, _, terminated, _, info = env.step(action)
            assert terminated == model.terminal[state]
            if terminated:
                break


def test_dense_views_give_back_the_arrays_a_model_was_built_from() -> None:
    model = small(first_observation=[0.2, 0.3, 0.5])
    for action in range(2):
        np.testing.assert_array_equal(model.transition_matrix(action), SMALL["transitions"][action])
        np.testing.assert_array_equal(model.observation_matrix(action), SMALL["observations"][action])
    np.testing.assert_array_equal(model.start_distribution(), SMALL["start"])
    np.testing.assert_array_equal(model.first_observation_matrix(), [[0.2, 0.3, 0.5]] * 2)
    expected = np.einsum("ast,ast->sa", SMALL["transitions"], SMALL["rewards"])
    np.testing.assert_allclose(model.expected_rewards(), expected, rtol=1e-15)


def test_the_reward_is_that_of_the_transition_that_happened() -> None:
    env = KernelEnv(tabular_task(small(), 10_000))
    rewards, before = np.array(SMALL["rewards"]), env.reset(seed=0)[1]["state"]
    for action in np.random.default_rng(0).integers(2, size=300):
        _, reward, _, _, info = env.step(action)
        assert reward == rewards[action, before, info["state"]]
        before = info["state"]


def test_frequencies_are_those_of_the_tables(noisy_pomdp: TabularPOMDP) -> None:
    model, n = noisy_pomdp, 20_000
    vector = KernelVectorEnv(tabular_task(model, 10), n)
    _, info = vector.reset(seed=0)
    states = info["state"]
    assert chi_square(states, model.start_distribution()) > 1e-3
    actions = np.random.default_rng(1).integers(3, size=n)
    observations, *_, info = vector.step(actions)
    symbols = np.argmax((observations[:, None] == model.features.astype(np.float32)).all(axis=2), axis=1)
    for action in range(3):
        move, see = model.transition_matrix(action), model.observation_matrix(action)
        for state in set(states):
            chosen = (actions == action) & (states == state)
            assert chi_square(info["state"][chosen], move[state]) > 1e-4
        for state in set(info["state"]):
            chosen = (actions == action) & (info["state"] == state)
            assert chi_square(symbols[chosen], see[state]) > 1e-4


def chi_square(outcomes: NDArray[np.int64], probabilities: NDArray[np.float64]) -> float:
    counts = np.bincount(outcomes, minlength=len(probabilities))
    possible = probabilities > 0
    assert counts[~possible].sum() == 0
    if possible.sum() == 1:
        return 1.0
    return float(stats.chisquare(counts[possible], probabilities[possible] * counts.sum()).pvalue)


def test_without_a_first_observation_nothing_is_seen_at_the_start() -> None:
    model = small(observation_names=("left", "right", "middle"))
    observation, _ = KernelEnv(tabular_task(model, 5)).reset(seed=0)
    assert observation.tolist() == [0, 0, 0]
    assert model.observation_names == ("left", "right", "middle", "nothing")


def test_an_ended_episode_stays_where_it_is_without_reward() -> None:
    env = KernelEnv(tabular_task(small(terminal=[1], start=[1, 0]), 100))
    env.reset(seed=1)
    while not env.step(1)[2]:
        pass
    for action in (0, 1, 0):
        _, reward, terminated, _, info = env.step(action)
        assert (reward, terminated, info["state"]) == (0, True, 1)


def test_a_kernel_survives_any_number_as_an_action(noisy_pomdp: TabularPOMDP) -> None:
    kernel = tabular_kernel(noisy_pomdp)
    state, noise = np.zeros((2, LANES)), np.full((4, LANES), 0.5)
    reward, over = np.empty(LANES), np.empty(LANES, np.bool_)
    action = np.tile([np.nan, np.inf, -np.inf, 1e300, -7, 3, 2, 0], 2)[None].astype(np.float64)
    kernel.step(kernel.floats, kernel.ints, noise, action, state, reward, over, LANES)
    nearest = np.zeros((2, LANES))
    kernel.step(
        kernel.floats, kernel.ints, noise, np.clip(np.nan_to_num(action), 0, 2), nearest, reward.copy(), over, LANES
    )
    assert (state[:, 3:8] == nearest[:, 3:8])[:, 1:].all()
    assert ((state[0] >= 0) & (state[0] < 6)).all()


def test_a_reward_may_be_random() -> None:
    model = TabularPOMDP.from_entries(
        shape=(1, 1),
        start=[1],
        states=0,
        actions=0,
        next_states=[0, 0],
        probabilities=[0.25, 0.75],
        rewards=[3.0, -1.0],
        observations=Distributions.from_dense([[1.0]]),
        observation_row=0,
        first_observation_row=0,
    )
    assert model.expected_rewards().tolist() == [[0]]
    assert model.transition_matrix(0).tolist() == [[1]]
    env = KernelEnv(tabular_task(model, 5000))
    env.reset(seed=0)
    rewards = np.array([env.step(0)[1] for _ in range(4000)])
    assert set(rewards) == {3.0, -1.0}
    assert abs((rewards == 3).mean() - 0.25) < 0.03


def test_a_uniform_start_over_many_states_is_uniform() -> None:
    n = 1000
    model = TabularPOMDP.from_entries(
        shape=(n, 1),
        start=np.full(n, 1 / n),
        states=np.arange(n),
        actions=0,
        next_states=np.arange(n),
        observations=Distributions.from_dense([[1.0]]),
        observation_row=0,
        first_observation_row=0,
    )
    states = KernelVectorEnv(tabular_task(model, 5), 50_000).reset(seed=0)[1]["state"]
    assert chi_square(states, model.start_distribution()) > 1e-3
    assert model.start.probabilities.sum() == pytest.approx(1)


def test_entries_may_come_in_any_order() -> None:
    random = np.random.default_rng(0)
    state, action, following = np.nonzero(np.array(SMALL["transitions"]).transpose(1, 0, 2))
    probability = np.array(SMALL["transitions"])[action, state, following]
    order = random.permutation(len(state))
    model = TabularPOMDP.from_entries(
        shape=(2, 2),
        start=SMALL["start"],
        states=state[order],
        actions=action[order],
        next_states=following[order],
        probabilities=probability[order],
        observations=Distributions.from_dense(np.eye(2)),
        observation_row=[[0], [1]],
        first_observation_row=[0, 1],
    )
    for a in range(2):
        np.testing.assert_array_equal(model.transition_matrix(a), SMALL["transitions"][a])
    assert all(low < high for low, high in pairwise(model.transitions.starts))


def changed(name: str, index: tuple[int, ...], value: float) -> dict[str, Any]:
    array = np.array(SMALL[name], np.float64)
    array[index] = value
    return {name: array}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (changed("transitions", (1, 0, 0), 0.4), "next state of state 0, action 1: .* sum to 0.9, not 1"),
        (changed("transitions", (0, 1, 1), 0.0), "no next state is given for state 1, action 0"),
        (changed("transitions", (0, 0, 1), np.nan), "next state 1 of state 0, action 0 has probability nan"),
        (changed("transitions", (0, 0, 1), -0.1), "probability -0.1, which is not above 0"),
        (changed("observations", (0, 0, 1), 0.5), "observation of state 0, action 0: .* sum to 1.5, not 1"),
        ({"first_observation": [0.5, 0.4, 0]}, "observation of state 0 at the start: .* sum to 0.9, not 1"),
        (changed("rewards", (0, 0, 0), np.inf), "rewards must be finite"),
        (changed("start", (0,), 0.5), "start state of the model: the probabilities sum to 1.25, not 1"),
        ({"features": np.full((3, 2), np.nan)}, "features must be finite"),
        ({"features": np.ones((5, 2))}, "symbols, features"),
        ({"features": np.ones(3)}, "features must have shape"),
        ({"discount": 1.5}, r"discount must be in \[0, 1\], got 1.5"),
        ({"discount": np.nan}, r"discount must be in \[0, 1\], got nan"),
        ({"terminal": [2]}, r"terminal must be in 0 .. 1, got 2 .. 2"),
        ({"terminal": [0]}, "cannot start in a terminal state"),
        ({"start": [1, 0, 0]}, "start must be one row over 2 states"),
        ({"transitions": np.ones((2, 2, 3))}, r"transitions must have shape \(A, S, S\), got \(2, 2, 3\)"),
        ({"observations": np.ones((2, 3, 3))}, r"observations must have shape \(2, 2, Z\)"),
        ({"action_names": ("one",)}, "action_names must have 2 names or none, got 1"),
    ],
)
def test_a_model_that_makes_no_sense_is_refused_with_the_reason(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        small(**changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"states": [0, 2]}, "states must be in 0 .. 1, got 0 .. 2"),
        ({"actions": [0, 1]}, "actions must be in 0 .. 0, got 0 .. 1"),
        ({"next_states": [0, 2]}, "next state 2 of state 1, action 0 is outside 0 .. 1"),
        ({"observation_row": 1}, "observation_row must be in 0 .. 0"),
        ({"first_observation_row": -1}, "first_observation_row must be in 0 .. 0"),
    ],
)
def test_entries_out_of_range_are_refused(changes: dict[str, Any], message: str) -> None:
    entries: dict[str, Any] = {
        "shape": (2, 1),
        "start": [1, 0],
        "states": [0, 1],
        "actions": 0,
        "next_states": [1, 0],
        "observations": Distributions.from_dense([[1.0]]),
        "observation_row": 0,
        "first_observation_row": 0,
    }
    TabularPOMDP.from_entries(**entries)
    with pytest.raises(ValueError, match=message):
        TabularPOMDP.from_entries(**{**entries, **changes})


def test_a_terminal_state_that_leads_elsewhere_is_refused() -> None:
    model = small()
    with pytest.raises(ValueError, match="terminal state 1 must lead back to itself with reward 0"):
        TabularPOMDP(
            start=Distributions.from_dense([1.0, 0.0]),
            transitions=model.transitions,
            rewards=model.rewards,
            observations=model.observations,
            observation_row=model.observation_row,
            first_observation_row=model.first_observation_row,
            features=model.features,
            terminal=np.array([False, True]),
        )
