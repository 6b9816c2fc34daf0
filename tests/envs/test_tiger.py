from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from dpsearch.envs import Tiger
from dpsearch.envs.tiger import (
    HEARD_LEFT,
    HEARD_RIGHT,
    LISTEN,
    NOTHING,
    OPEN_LEFT,
    OPEN_RIGHT,
    TigerVector,
    tiger_pomdp,
)
from dpsearch.pomdp import BeliefFilter
from dpsearch.rollout import make_rollouts
from tests.support.exact import Machine, machine, play
from tests.support.twin import require_same

ID = "dpsearch.envs:dpsearch/Tiger-v0"


class PlainTiger:
    """The Tiger problem once more, straight from its definition. States: where the tiger is, whether all is over."""

    def __init__(self, single: bool) -> None:
        self.single = single

    def states(self) -> list[tuple[str, bool]]:
        return [(side, over) for over in ((False, True) if self.single else (False,)) for side in ("left", "right")]

    def start(self) -> list[tuple[float, tuple[str, bool]]]:
        return [(0.5, ("left", False)), (0.5, ("right", False))]

    def over(self, state: tuple[str, bool]) -> bool:
        return state[1]

    def step(self, state: tuple[str, bool], action: int) -> list[tuple[float, tuple[str, bool], float]]:
        if action == 0:
            return [(1.0, state, -1.0)]
        opened = {1: "left", 2: "right"}[action]
        reward = -100.0 if opened == state[0] else 10.0
        if self.single:
            return [(1.0, (state[0], True), reward)]
        return [(0.5, ("left", False), reward), (0.5, ("right", False), reward)]

    def sees(self, state: tuple[str, bool], action: int | None) -> Iterable[tuple[float, tuple[float, ...]]]:
        if action is None:
            return [(1.0, (0.0, 0.0))]
        left = 0.5 if action != 0 or state[1] else {"left": 0.85, "right": 0.15}[state[0]]
        return [(left, (1.0, -1.0)), (1 - left, (-1.0, 1.0))]


@pytest.mark.parametrize("single", [False, True])
def test_the_tables_are_as_the_definition_says(single: bool) -> None:
    require_same(tiger_pomdp(single), PlainTiger(single))


def heard_more(lead: int, early: int | None = None) -> Machine:
    """Listens until one side was heard ``lead`` times more often, then opens the other; ``early`` after two listens."""

    def act(memory: tuple[int, int]) -> int:
        more, listens = memory  # how much more often it was heard on the left
        enough = early if early is not None and listens == 2 else lead
        return LISTEN if abs(more) < enough else OPEN_RIGHT if more > 0 else OPEN_LEFT

    def following(memory: tuple[int, int], symbol: int) -> tuple[int, int]:
        if act(memory) != LISTEN or symbol == NOTHING:
            return 0, 0
        return memory[0] + (1 if symbol == HEARD_LEFT else -1), min(memory[1] + 1, 3)

    return machine(tiger_pomdp(), lambda symbol: (0, 0), act, following)


@pytest.mark.parametrize(
    ("lead", "printed"),
    [
        (1, "-375.000 -3.75000 -3.75000 -13.42857 100"),
        (2, "106.102 1.06102 1.06102 1.93344 100"),
        (3, "96.039 0.96039 0.96039 0.59565 100"),
    ],
)
def test_listening_until_one_side_leads_earns_what_is_known(lead: int, printed: str) -> None:
    play(tiger_pomdp(), heard_more(lead), 100).require(printed)


@pytest.mark.parametrize(
    ("lead", "early", "printed"),
    [
        (2, None, "3.99329 1.08379 1.26487 1.22401 3.68456"),
        (3, None, "5.15992 0.98493 1.18516 0.44737 5.23887"),
        (3, 2, "4.29078 1.05143 1.29323 1.11261 4.08091"),
    ],
)
def test_listening_before_a_single_opening_earns_what_is_known(lead: int, early: int | None, printed: str) -> None:
    play(tiger_pomdp(single=True), heard_more(lead, early), 100).require(printed)


def test_no_policy_earns_more_than_107_in_100_steps() -> None:
    """Dynamic programming over how much more often one side was heard since the last opening, and the steps left."""
    more = np.arange(-101, 102)
    left = 1 / (1 + (0.15 / 0.85) ** more)
    best = np.zeros(203)
    for _ in range(100):
        hear_left = 0.85 * left + 0.15 * (1 - left)
        listen = -1 + hear_left * np.roll(best, -1) + (1 - hear_left) * np.roll(best, 1)
        open_one = 10 - 110 * np.minimum(left, 1 - left) + best[101]
        best = np.maximum(listen, open_one)
    assert best[101] == pytest.approx(107.077, abs=5e-4)


@pytest.mark.parametrize(
    ("lead", "single", "threshold", "at_least", "at_most"),
    [
        (2, False, 80, 0.96, 1),
        (3, False, 80, 0.98, 1),
        (4, False, 80, 0, 0),
        (2, True, 2, 0.7, 1),
        (3, True, 2, 0.95, 1),
    ],
)
def test_good_policies_pass_the_threshold_in_100_episodes(
    lead: int, single: bool, threshold: float, at_least: float, at_most: float
) -> None:
    env = TigerVector(num_envs=20_000, single=single, autoreset_mode="SameStep")
    assert env.reward_threshold == threshold
    policy = heard_more(lead)
    decide, following = policy.actions.argmax(axis=1), np.asarray(policy.following)
    env.reset(seed=1)
    node, total, alive = np.zeros(20_000, np.int64), np.zeros(20_000), np.ones(20_000, np.bool_)
    for _ in range(100):
        observations, rewards, terminated, truncated, _ = env.step(decide[node])
        node = following[node, np.where(observations[:, 0] > 0, HEARD_LEFT, HEARD_RIGHT)]
        total += rewards * alive
        alive &= ~(terminated | truncated)
    passed = total.reshape(200, 100).mean(axis=1) >= threshold
    assert at_least <= passed.mean() <= at_most


def test_what_is_heard_after_opening_a_door_says_nothing() -> None:
    beliefs = BeliefFilter(tiger_pomdp())
    belief = beliefs.start([NOTHING])
    assert belief.tolist() == [[0.5, 0.5]]
    for _ in range(2):
        belief = beliefs.update(belief, [LISTEN], [HEARD_LEFT])
    assert belief[0, 0] == pytest.approx(0.85**2 / (0.85**2 + 0.15**2))
    belief = beliefs.update(belief, [OPEN_RIGHT], [HEARD_LEFT])
    assert belief.tolist() == [[0.5, 0.5]]


def test_sounds_come_as_plus_and_minus_one_and_nothing_as_zeros() -> None:
    env = Tiger()
    observation, _ = env.reset(seed=0)
    assert observation.tolist() == [0, 0]
    assert env.observation_space == gym.spaces.Box(-1, 1, (2,), np.float32)
    heard = {tuple(env.step(LISTEN)[0].tolist()) for _ in range(60)}
    assert heard == {(1, -1), (-1, 1)}


def test_listening_is_right_85_times_of_100() -> None:
    env = TigerVector(num_envs=20_000)
    env.reset(seed=3)
    observations, rewards, _, _, info = env.step(np.full(20_000, LISTEN))
    right = (observations[:, 0] > 0) == (info["state"] == 0)
    assert right.mean() == pytest.approx(0.85, abs=0.01)
    assert (rewards == -1).all()


def test_opening_a_door_ends_a_single_problem_only() -> None:
    for single in (False, True):
        env = Tiger(single=single)
        tiger = env.reset(seed=5)[1]["state"]
        _, reward, terminated, truncated, _ = env.step(OPEN_LEFT)
        assert (reward, terminated, truncated) == (-100 if tiger == 0 else 10, single, False)


def test_episodes_last_100_steps_unless_told_otherwise() -> None:
    for limit in (None, 30):
        env = Tiger(max_episode_steps=limit)
        env.reset(seed=0)
        cut = [env.step(OPEN_LEFT)[3] for _ in range(limit or 100)]
        assert cut == [False] * (len(cut) - 1) + [True]
        assert env.reward_threshold == pytest.approx(0.8 * len(cut))


@pytest.mark.parametrize("single", [1, 0, None, "yes"])
def test_single_must_be_true_or_false(single: Any) -> None:
    for make in (Tiger, TigerVector, lambda single: gym.make(ID, single=single)):
        with pytest.raises(ValueError, match=f"single must be True or False, got {single!r}"):
            make(single=single)


def test_a_shorter_episode_is_solved_with_as_much_a_step() -> None:
    assert make_rollouts(ID, max_episode_steps=10).reward_threshold == 8.0
    assert make_rollouts(ID, env_kwargs={"single": True}, max_episode_steps=10).reward_threshold == 2.0
