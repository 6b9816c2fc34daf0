from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.solvers.agents import BeliefAgent, Controller, fully_observed
from dpsearch.pomdp.solvers.play import play
from dpsearch.pomdp.task import tabular_task

GOOD: dict[str, Any] = {
    "actions": np.array([[0.5, 0.5], [1.0, 0.0]]),
    "first": np.array([0, 1, 0]),
    "following": np.zeros((2, 2, 3), np.int64),
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"following": np.zeros((2, 3, 3), np.int64)}, "shapes must be"),
        ({"first": np.array([0, 2, 0])}, "first must hold nodes from 0 to 1"),
        ({"following": np.full((2, 2, 3), -1)}, "following must hold nodes from 0 to 1"),
        ({"actions": np.array([[0.5, 0.6], [1.0, 0.0]])}, "sum to 1"),
        ({"actions": np.array([[1.5, -0.5], [1.0, 0.0]])}, "sum to 1"),
    ],
)
def test_a_controller_that_does_not_fit_is_refused(change: dict[str, Any], message: str) -> None:
    Controller(**GOOD)
    with pytest.raises(ValueError, match=message):
        Controller(**{**GOOD, **change})


def test_a_controller_draws_its_actions_with_their_probabilities() -> None:
    controller = Controller.memoryless([[0.2, 0.0, 0.8], [0.0, 1.0, 0.0]])
    uniforms = np.linspace(0, 1, 1_000, endpoint=False)
    drawn = controller.choose(np.zeros(1_000, np.int64), uniforms)
    np.testing.assert_array_equal(np.bincount(drawn), [200, 0, 800])
    assert (controller.choose(np.ones(1_000, np.int64), uniforms) == 1).all()


def test_a_controller_remembers_what_its_table_says() -> None:
    following = np.arange(12).reshape(2, 2, 3) % 2
    controller = Controller(**{**GOOD, "following": following})
    np.testing.assert_array_equal(controller.start(np.array([1, 2])), [1, 0])
    nodes = controller.update(np.array([1, 0]), np.array([0, 1]), np.array([2, 1]))
    np.testing.assert_array_equal(nodes, [following[1, 0, 2], following[0, 1, 1]])


def test_beliefs_are_the_shares_of_states_among_episodes_that_look_alike(noisy_pomdp: TabularPOMDP) -> None:
    """The memory of a belief agent against counting: simulated from the tables, grouped by all that was seen."""
    rng = np.random.default_rng(0)
    n, actions = 400_000, (1, 2)
    agent = BeliefAgent(noisy_pomdp, lambda beliefs: beliefs.argmax(axis=1))
    states = rng.choice(noisy_pomdp.n_states, n, p=noisy_pomdp.start_distribution())

    def drawn(rows: NDArray[np.float64]) -> NDArray[np.int64]:
        numbers: NDArray[np.int64] = (rows.cumsum(axis=1) <= rng.random((len(rows), 1))).sum(axis=1)
        return numbers.clip(max=rows.shape[1] - 1)

    symbols = drawn(noisy_pomdp.first_observation_matrix()[states])
    history = symbols
    memory = agent.start(np.arange(4))  # by history: a number in base 4
    for action in actions:
        states = drawn(noisy_pomdp.transition_matrix(action)[states])
        symbols = drawn(noisy_pomdp.observation_matrix(action)[states])
        goes_on = ~noisy_pomdp.terminal[states]
        states, symbols, history = states[goes_on], symbols[goes_on], history[goes_on]
        history = 4 * history + symbols
        seen = np.tile(np.arange(4), len(memory))
        memory = agent.update(memory.repeat(4, axis=0), np.full(len(seen), action), seen)
    counts = np.zeros((len(memory), noisy_pomdp.n_states))
    np.add.at(counts, (history, states), 1)
    total = counts.sum(axis=1, keepdims=True)
    error = np.sqrt(memory * (1 - memory) / np.maximum(total, 1))
    assert (np.abs(counts / np.maximum(total, 1) - memory) <= 4.5 * error + 1e-12)[total[:, 0] > 100].all()
    assert not memory[:, 5].any()  # terminal


def test_who_sees_the_state_plays_the_same_episodes(noisy_pomdp: TabularPOMDP) -> None:
    always = Controller.memoryless(np.eye(3)[[1] * noisy_pomdp.n_symbols])
    always_seeing = Controller.memoryless(np.eye(3)[[1] * noisy_pomdp.n_states])
    unseen = play(tabular_task(noisy_pomdp, 20), always, 500, seed=3)
    seen = play(tabular_task(fully_observed(noisy_pomdp), 20), always_seeing, 500, seed=3)
    np.testing.assert_array_equal(unseen.returns, seen.returns)
    np.testing.assert_array_equal(unseen.lengths, seen.lengths)


def test_what_only_the_end_of_an_episode_shows_cannot_be_seen_before() -> None:
    ends = TabularPOMDP.from_dense(
        [[[0.5, 0.5], [0.0, 1.0]]], [[[1.0, 0.0], [0.0, 1.0]]], 0.0, [1.0, 0.0], terminal=[1], discount=0.9
    )
    agent = BeliefAgent(ends, lambda beliefs: beliefs.argmax(axis=1))
    memory = agent.start(np.array([2, 2]))
    np.testing.assert_array_equal(agent.update(memory, np.array([0, 0]), np.array([0, 0])), [[1, 0], [1, 0]])
    with pytest.raises(ValueError, match="episode 1 is impossible"):
        agent.update(memory, np.array([0, 0]), np.array([0, 1]))
