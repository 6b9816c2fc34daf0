from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from dpsearch.env_kit.vector_env import KernelVectorEnv
from dpsearch.envs.tmaze import CORRIDOR, EAST, JUNCTION, SIGN_DOWN, SIGN_UP, tmaze_pomdp
from dpsearch.pomdp import BeliefFilter, TabularPOMDP
from dpsearch.pomdp.task import tabular_task

Ints = NDArray[np.int64]


def by_enumeration(pomdp: TabularPOMDP, symbols: list[int], actions: list[int]) -> NDArray[np.float64]:
    """Probability of the last state given all symbols and actions, by summing over all paths of states."""
    start, first = pomdp.start_distribution(), pomdp.first_observation_matrix()
    moves = [pomdp.transition_matrix(action) for action in range(pomdp.n_actions)]
    seen = [pomdp.observation_matrix(action) for action in range(pomdp.n_actions)]
    weights = np.zeros(pomdp.n_states)
    for path in itertools.product(range(pomdp.n_states), repeat=len(symbols)):
        weight = start[path[0]] * first[path[0], symbols[0]]
        for before, after, action, symbol in zip(path, path[1:], actions, symbols[1:], strict=False):
            weight *= moves[action][before, after] * seen[action][after, symbol]
        weights[path[-1]] += weight
    belief: NDArray[np.float64] = weights / weights.sum()
    return belief


def episodes(pomdp: TabularPOMDP, n: int, steps: int) -> tuple[Ints, Ints, Ints]:
    """Symbols ``(steps + 1, n)``, actions ``(steps, n)`` and states of episodes, some of which end on the way."""
    env = KernelVectorEnv(tabular_task(pomdp, steps + 1), n)
    features, actions = pomdp.features.astype(np.float32), np.random.default_rng(1).integers(3, size=(steps, n))
    observations, info = env.reset(seed=0)
    seen, states = [observations], [info["state"]]
    for chosen in actions:
        observations, *_, info = env.step(chosen)
        seen.append(observations)
        states.append(info["state"])
    symbols = (np.stack(seen)[:, :, None] == features).all(axis=3).argmax(axis=2)
    return symbols, actions, np.stack(states)


def test_beliefs_are_the_probabilities_summed_over_all_paths(noisy_pomdp: TabularPOMDP) -> None:
    symbols, actions, states = episodes(noisy_pomdp, 24, 4)
    goes_on = ~(states[:-1] == 5).any(axis=0)  # an ended episode would have been followed by the next
    symbols, actions = symbols[:, goes_on], actions[:, goes_on]
    assert symbols.shape[1] >= 6
    beliefs = BeliefFilter(noisy_pomdp)
    belief = beliefs.start(symbols[0])
    for t in range(4):
        belief = beliefs.update(belief, actions[t], symbols[t + 1])
        for i in range(symbols.shape[1]):
            expected = by_enumeration(noisy_pomdp, symbols[: t + 2, i].tolist(), actions[: t + 1, i].tolist())
            np.testing.assert_allclose(belief[i], expected, rtol=1e-12)


def test_beliefs_side_by_side_are_those_of_each_episode_alone(noisy_pomdp: TabularPOMDP) -> None:
    beliefs, random = BeliefFilter(noisy_pomdp), np.random.default_rng(0)
    before = random.dirichlet(np.ones(6), 50)
    actions, symbols = random.integers(3, size=50), np.zeros(50, np.int64)  # all states may show symbol 0
    together = beliefs.update(before, actions, symbols)
    np.testing.assert_allclose(together.sum(axis=1), 1)
    for i in range(50):
        alone = beliefs.update(before[i : i + 1], actions[i : i + 1], symbols[i : i + 1])
        np.testing.assert_allclose(alone[0], together[i], rtol=1e-14)


def test_whether_an_episode_ended_is_knowledge_too(noisy_pomdp: TabularPOMDP) -> None:
    beliefs = BeliefFilter(noisy_pomdp)
    before, actions, symbols = np.full((2, 6), 1 / 6), [0, 0], [0, 0]
    unknown = beliefs.update(before, actions, symbols)[0]
    went_on, ended = beliefs.update(before, actions, symbols, [False, True])
    np.testing.assert_allclose(went_on[:5], unknown[:5] / unknown[:5].sum())
    np.testing.assert_array_equal(ended, np.eye(6)[5])


def test_an_average_belief_is_right_about_the_state(noisy_pomdp: TabularPOMDP) -> None:
    """Of the states believed in with probability p, a share of p is where the agent is."""
    symbols, actions, states = episodes(noisy_pomdp, 20_000, 2)
    goes_on = ~(states[:-1] == 5).any(axis=0)
    symbols, actions, states = symbols[:, goes_on], actions[:, goes_on], states[:, goes_on]
    beliefs = BeliefFilter(noisy_pomdp)
    belief = beliefs.start(symbols[0])
    for t in range(2):
        belief = beliefs.update(belief, actions[t], symbols[t + 1])
    there = states[-1][:, None] == np.arange(6)
    for low, high in itertools.pairwise(np.linspace(0, 1, 6)):
        chosen = (belief > low) & (belief <= high)
        if chosen.sum() > 200:
            error = np.sqrt(belief[chosen].mean() / chosen.sum())
            assert there[chosen].mean() == pytest.approx(belief[chosen].mean(), abs=4 * error)


def test_the_sign_is_known_to_whoever_remembers_it() -> None:
    pomdp = tmaze_pomdp(2)
    beliefs = BeliefFilter(pomdp)
    belief = beliefs.start([SIGN_UP, SIGN_DOWN])
    for symbol in (CORRIDOR, JUNCTION):
        belief = beliefs.update(belief, [EAST, EAST], [symbol, symbol])
    assert np.argwhere(belief == 1).tolist() == [[0, 2], [1, 5]]


def test_what_cannot_be_seen_is_refused() -> None:
    beliefs = BeliefFilter(tmaze_pomdp(2))
    with pytest.raises(ValueError, match="what was seen in episode 1 is impossible by the model"):
        beliefs.start([SIGN_UP, CORRIDOR])
    belief = beliefs.start([SIGN_UP, SIGN_DOWN])
    with pytest.raises(ValueError, match="what was seen in episode 0 is impossible by the model"):
        beliefs.update(belief, [EAST, EAST], [JUNCTION, CORRIDOR])
