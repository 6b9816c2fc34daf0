import numpy as np
import pytest

from dpsearch.envs.tmaze import EAST, JUNCTION, NORTH
from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.solvers.agents import Controller
from dpsearch.pomdp.solvers.exact import controller_of, exact_metrics
from dpsearch.pomdp.solvers.play import play
from dpsearch.pomdp.solvers.returns import Metrics
from dpsearch.pomdp.task import tabular_task
from scripts.experiments.pomdps.hand_written import qmdp
from tests.support.optima import MEMORYLESS, RANDOM, assert_as_printed, task, values


def some_controller(seed: int, nodes: int = 3, actions: int = 3, symbols: int = 4) -> Controller:
    rng = np.random.default_rng(seed)
    return Controller(
        rng.dirichlet(np.ones(actions), nodes),
        rng.integers(nodes, size=symbols),
        rng.integers(nodes, size=(nodes, actions, symbols)),
    )


def by_enumeration(pomdp: TabularPOMDP, controller: Controller, steps: int) -> tuple[float, ...]:
    """The metrics, from all the episodes that there can be: one tuple (probability, return, discounted, steps) each."""
    moves = [pomdp.transition_matrix(a) for a in range(pomdp.n_actions)]
    seen = [pomdp.observation_matrix(a) for a in range(pomdp.n_actions)]
    reward = np.zeros((pomdp.n_actions, pomdp.n_states, pomdp.n_states))
    row = pomdp.transitions.row_of_entry()
    reward[row % pomdp.n_actions, row // pomdp.n_actions, pomdp.transitions.columns] = pomdp.rewards
    episodes: list[tuple[float, float, float, int]] = []

    def go_on(state: int, node: int, chance: float, earned: float, discounted: float, t: int) -> None:
        if t == steps or pomdp.terminal[state]:
            episodes.append((chance, earned, discounted, t))
            return
        for action in range(pomdp.n_actions):
            for after in np.flatnonzero(moves[action][state]):
                paid = reward[action, state, after]
                for symbol in np.flatnonzero(seen[action][after]):
                    here = controller.actions[node, action] * moves[action][state, after] * seen[action][after, symbol]
                    go_on(
                        int(after),
                        int(controller.following[node, action, symbol]),
                        chance * here,
                        earned + paid,
                        discounted + pomdp.discount**t * paid,
                        t + 1,
                    )

    first = pomdp.first_observation_matrix()
    for state, begins in enumerate(pomdp.start_distribution()):
        for symbol in np.flatnonzero(first[state] * begins):
            go_on(state, int(controller.first[symbol]), begins * first[state, symbol], 0.0, 0.0, 0)
    chance, earned, discounted, length = np.array(episodes).T
    assert chance.sum() == pytest.approx(1)
    return (
        chance @ earned,
        (chance @ earned) / (chance @ length),
        chance @ (earned / length),
        chance @ discounted,
        chance @ length,
    )


@pytest.mark.parametrize("seed", [0, 1])
def test_the_metrics_are_those_of_all_episodes_enumerated(noisy_pomdp: TabularPOMDP, seed: int) -> None:
    controller = some_controller(seed)
    found = values(exact_metrics(tabular_task(noisy_pomdp, 3), controller))
    assert found == pytest.approx(by_enumeration(noisy_pomdp, controller, 3), rel=1e-12)


@pytest.mark.parametrize("name", RANDOM)
def test_a_random_policy_achieves_what_was_computed_elsewhere(name: str) -> None:
    played = task(name)
    assert_as_printed(exact_metrics(played, Controller.random(played.pomdp)), RANDOM[name])


@pytest.mark.parametrize("name", MEMORYLESS)
def test_without_memory_half_of_the_turns_are_wrong(name: str) -> None:
    actions = np.full(4, EAST)
    actions[JUNCTION] = NORTH
    assert_as_printed(exact_metrics(task(name), Controller.memoryless(np.eye(4)[actions])), MEMORYLESS[name])


def assert_within_errors(exact: Metrics, simulated: Metrics) -> None:
    """Within four standard errors of each metric, which the simulation must have."""
    for name in ("episode_return", "reward_per_step", "thesis_metric", "discounted_return", "steps"):
        estimate = getattr(simulated, name)
        assert getattr(exact, name).standard_error == 0.0
        assert estimate.standard_error > 0
        assert abs(getattr(exact, name).value - estimate.value) < 4 * estimate.standard_error


def test_simulation_agrees(noisy_pomdp: TabularPOMDP) -> None:
    played = tabular_task(noisy_pomdp, 30)
    controller = some_controller(2)
    assert_within_errors(exact_metrics(played, controller), play(played, controller, 20_000).metrics())


def test_an_agent_on_few_beliefs_is_a_controller_that_plays_the_same_episodes() -> None:
    played = task("tiger, single")
    agent = qmdp(played.pomdp)
    np.testing.assert_array_equal(play(played, agent, 300).returns, play(played, controller_of(agent), 300).returns)


def test_an_agent_on_too_many_beliefs_is_not() -> None:
    with pytest.raises(ValueError, match="more than 50 different beliefs"):
        controller_of(qmdp(task("maze4x3").pomdp), most=50)


def test_a_controller_for_another_task_is_refused() -> None:
    with pytest.raises(ValueError, match="3 actions and 4 symbols, the task 4 and 4"):
        exact_metrics(task("tmaze 3"), some_controller(0))
