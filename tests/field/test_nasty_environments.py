"""Environments that others wrote: each trains with every kind of algorithm, and plays as a plain loop would."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from dpsearch import LRWR, RPG, PolicyConfig, XNESPolicySearch
from dpsearch.algos import Algorithm
from dpsearch.kernels.philox import episode_seeds
from dpsearch.rollout import EnvironmentFailedError, GymEngine
from tests.support import nasty_envs
from tests.support.application import summary, train
from tests.support.nasty_envs import Shown, Taken, Wrong

SOUND: dict[str, Callable[[], gym.Env[Any, Any]]] = {
    **{f"shows {kind}": partial(Shown, kind) for kind in Shown.kinds},
    **{f"takes {kind}": partial(Taken, kind) for kind in Taken.kinds},
    **{
        name: getattr(nasty_envs, name)
        for name in (
            *("Light", "OneArray", "SharedArray", "WritesIntoActions", "OneStep", "ArrayRewards", "VariableInfos"),
        )
    },
}
IDS = sorted(name for name, spec in gym.registry.items() if str(spec.entry_point).startswith(nasty_envs.__name__))
LEARNERS: dict[str, Callable[..., Algorithm[Any]]] = {
    "rpg": partial(RPG, batch_size=4),
    "lrwr": partial(LRWR, batch_size=4, max_epochs=2),
    "xnes": partial(XNESPolicySearch, population=4),
}
pytestmark = pytest.mark.filterwarnings(
    "ignore:.*is left out", "ignore:.*WARN", "ignore:.*[Bb]ox", "ignore:observations are of size"
)


def returns_of_a_plain_loop(algorithm: Algorithm[Any], env: gym.Env[Any, Any], seeds: list[int]) -> list[float]:
    """What a user's own loop over `predict` makes of the episodes with these seeds."""
    found = []
    for seed in seeds:
        (observation, _), state, total, over = env.reset(seed=seed), None, 0.0, False
        while not over:
            action, state = algorithm.predict(observation, state, deterministic=True)
            if isinstance(env.observation_space, gym.spaces.Discrete) and np.ndim(observation) == 1:
                action = action[0]  # `array([2])` of a Discrete space is a batch of one
            observation, reward, terminated, truncated, _ = env.step(action)
            paid: Any = reward
            total += float(np.ravel(paid)[0])
            over = bool(terminated or truncated)
        found.append(total)
    return found


@pytest.mark.parametrize("learner", LEARNERS)
@pytest.mark.parametrize("name", SOUND)
def test_it_trains_and_evaluates_as_a_plain_loop_does(name: str, learner: str) -> None:
    policy = PolicyConfig(hidden_size=3, init_range=0.5)
    algorithm = LEARNERS[learner](SOUND[name], policy=policy, max_episode_steps=20)
    algorithm.learn(total_updates=2)
    assert all(np.isfinite(algorithm.policy.vector()))
    evaluated = algorithm.evaluate(3, deterministic=True)
    numbers = (algorithm.updates << 24) + np.arange(3, dtype=np.uint64)
    seeds = episode_seeds(algorithm.evaluation_key, numbers).tolist()
    assert evaluated.returns.tolist() == returns_of_a_plain_loop(algorithm, SOUND[name](), seeds)
    algorithm.close()


@pytest.mark.parametrize("env_id", IDS)
def test_it_trains_from_the_command_line(env_id: str, tmp_path: Path) -> None:
    outcome = train(
        *("algo=rpg", "env=gym", f"env.id=tests.support.nasty_envs:{env_id}", "total_updates=2", "progress=false"),
        *("algo.batch_size=4", "policy.hidden_size=3", "evaluation_episodes=2", f"run_dir={tmp_path / 'run'}"),
    )
    assert outcome.code == 0, outcome.err
    assert summary(tmp_path / "run")["episodes"] == 8


@pytest.mark.parametrize("learner", LEARNERS)
@pytest.mark.parametrize("how", ["raises", "nan", "infinity", "shape", "nothing", "two rewards", "a word", "no reward"])
def test_what_breaks_the_rules_is_refused_in_one_line(how: str, learner: str) -> None:
    algorithm = LEARNERS[learner](partial(Wrong, how), policy=PolicyConfig(hidden_size=3), max_episode_steps=20)
    message = r"the environment failed at step \d of episode \d+, seed \d+: .+"
    with pytest.raises(EnvironmentFailedError, match=message) as error:
        algorithm.learn(total_updates=1)
    assert re.fullmatch(message, str(error.value))


def test_an_environment_whose_limit_is_none_is_played_to_its_end() -> None:
    with pytest.warns(UserWarning, match="max_episode_steps is taken to be 1000"):
        algorithm = RPG(nasty_envs.NoLimit, batch_size=4)
    assert set(algorithm.evaluate(5).lengths) == {nasty_envs.STEPS}


@pytest.mark.parametrize("vector", [nasty_envs.same_step_vector, partial(nasty_envs.LightVector, 3)])
def test_a_vector_environment_that_came_ready_trains(vector: Any) -> None:
    env = vector()
    algorithm = RPG(env, batch_size=4, policy=PolicyConfig(hidden_size=3), max_episode_steps=20)
    algorithm.learn(total_updates=2)
    assert set(algorithm.evaluate(5).lengths) == {nasty_envs.STEPS}
    env.close()


def test_a_vector_class_of_its_own_trains() -> None:
    engine = GymEngine("tests/Light-v0", num_envs=3, vectorization="vector_entry_point", max_episode_steps=20)
    algorithm = RPG(engine, batch_size=4, policy=PolicyConfig(hidden_size=3))
    algorithm.learn(total_updates=2)
    assert set(algorithm.evaluate(5).lengths) == {nasty_envs.STEPS}
    algorithm.close()
