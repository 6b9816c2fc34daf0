from __future__ import annotations

from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from dpsearch.envs import ShuttleDocking
from dpsearch.envs.shuttle import (
    BACK_UP,
    DOCKED_AT_LRV,
    DOCKED_AT_MRV,
    GO_FORWARD,
    TURN_AROUND,
    ShuttleDockingVector,
    shuttle_pomdp,
)
from tests.support.exact import Machine, machine, play, solve
from tests.support.twin import require_same

# Where the shuttle is, and which station is ahead ("" in a dock).
NAMES = {
    0: ("dock LRV", ""),
    1: ("MRV", "MRV"),
    2: ("space", "MRV"),
    3: ("LRV", "MRV"),
    4: ("MRV", "LRV"),
    5: ("space", "LRV"),
    6: ("LRV", "LRV"),
    7: ("dock MRV", ""),
}
Situation = tuple[str, str]


class PlainShuttle:
    """Shuttle docking once more, from its definition. Only what becomes of backing up is copied from the table."""

    backing = {
        1: {1: 0.4, 2: 0.3, 4: 0.3},
        2: {2: 0.1, 3: 0.8, 6: 0.1},
        3: {0: 0.7, 3: 0.3},
        4: {4: 0.3, 7: 0.7},
        5: {1: 0.1, 4: 0.8, 5: 0.1},
        6: {3: 0.3, 5: 0.3, 6: 0.4},
    }

    def states(self) -> list[Situation]:
        return [NAMES[i] for i in range(8)]

    def start(self) -> list[tuple[float, Situation]]:
        return [(1.0, ("dock MRV", ""))]

    def over(self, state: Situation) -> bool:
        return False

    def step(self, state: Situation, action: int) -> list[tuple[float, Situation, float]]:
        place, ahead = state
        other = {"LRV": "MRV", "MRV": "LRV"}
        if place.startswith("dock"):  # on leaving LRV it becomes MRV, so either dock is MRV's from then on
            return [(1.0, [("MRV", "MRV"), ("MRV", "LRV"), ("dock MRV", "")][action], 0.0)]
        if action == TURN_AROUND:
            return [(1.0, (place, other[ahead]), 0.0)]
        if action == GO_FORWARD:
            if place == ahead:
                return [(1.0, state, -3.0)]
            return [(1.0, ("space" if place == other[ahead] else ahead, ahead), 0.0)]
        number = {situation: i for i, situation in NAMES.items()}
        return [
            (p, NAMES[after], 10.0 if NAMES[after][0] == "dock LRV" else 0.0)
            for after, p in self.backing[number[state]].items()
        ]

    def sees(self, state: Situation, action: int | None) -> list[tuple[float, tuple[float, ...]]]:
        def one_hot(name: str) -> tuple[float, ...]:
            return tuple(float(name == own) for own in ("LRV", "MRV", "dock MRV", "nothing", "dock LRV"))

        place, ahead = state
        if place.startswith("dock"):
            return [(1.0, one_hot(place))]
        if place == "space":
            return [(0.7, one_hot(ahead)), (0.3, one_hot("nothing"))]
        return [(1.0, one_hot(ahead if place == ahead else "nothing"))]


def test_the_tables_are_as_the_definition_says() -> None:
    require_same(shuttle_pomdp(), PlainShuttle())


def circuit() -> Machine:
    """Leave the dock, cross, approach, turn round, and back up until docked: it need only count its steps."""
    return machine(
        shuttle_pomdp(),
        first=lambda symbol: 0,
        act=lambda steps: (GO_FORWARD, GO_FORWARD, GO_FORWARD, TURN_AROUND, BACK_UP)[steps],
        following=lambda steps, symbol: 0 if symbol in (DOCKED_AT_LRV, DOCKED_AT_MRV) else min(steps + 1, 4),
    )


def test_flying_to_and_fro_is_optimal_and_earns_what_is_known() -> None:
    play(shuttle_pomdp(), circuit(), 1000).require("1838.130 1.83813 1.83813 14.50371 1000")
    forever = (
        play(shuttle_pomdp(), circuit(), 20_000).mean_return - play(shuttle_pomdp(), circuit(), 10_000).mean_return
    )
    assert forever / 10_000 == pytest.approx(10 / (4 + 1 / 0.7), abs=1e-9)


@pytest.mark.parametrize(("discount", "value"), [(0.9, 14.50371), (0.95, 32.88972)])
def test_who_sees_the_state_does_no_better(discount: float, value: float) -> None:
    pomdp = replace(shuttle_pomdp(), discount=discount)
    assert solve(pomdp, discount)[0] @ pomdp.start_distribution() == pytest.approx(value, abs=5e-6)
    assert play(pomdp, circuit(), 1000).discounted == pytest.approx(value, abs=5e-6)


def test_an_episode_of_deliveries() -> None:
    env, steps, total = ShuttleDocking(), 0, 0.0
    observation, info = env.reset(seed=0)
    assert (observation.tolist(), info["state"]) == ([0, 0, 1, 0, 0], 7)
    plan, deliveries = [GO_FORWARD, GO_FORWARD, GO_FORWARD, TURN_AROUND, BACK_UP], 0
    while True:
        observation, reward, terminated, truncated, _ = env.step(plan[min(steps, 4)])
        steps, total = steps + 1, total + reward
        assert not terminated
        if observation[4] == 1:  # docked at LRV: the reward was just paid
            assert reward == 10
            steps, deliveries = 0, deliveries + 1
        else:
            assert reward == 0
        if truncated:
            break
    assert env.elapsed_steps == 1000
    assert total == 10 * deliveries
    assert env.reward_threshold is not None
    assert total > env.reward_threshold


def test_observations_are_one_of_five() -> None:
    env = ShuttleDocking()
    assert env.observation_space == gym.spaces.Box(0, 1, (5,), np.float32)
    vector = ShuttleDockingVector(num_envs=200)
    observations, _ = vector.reset(seed=0)
    random = np.random.default_rng(0)
    for _ in range(30):
        assert (np.sort(observations, axis=1) == [0, 0, 0, 0, 1]).all()
        observations, *_ = vector.step(random.integers(3, size=200))


def test_the_threshold_grows_with_the_limit() -> None:
    assert ShuttleDocking().reward_threshold == 1700
    assert ShuttleDocking(max_episode_steps=100).reward_threshold == pytest.approx(170)
