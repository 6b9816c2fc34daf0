"""Environments that raise, or show or pay what is not a finite number of the right shape."""

from functools import partial
from typing import Any
from unittest import mock

import numpy as np
import pytest

from dpsearch.kernels.philox import episode_seeds
from dpsearch.policies import PolicyConfig, RecurrentPolicy
from dpsearch.rollout import EnvironmentFailedError, Episodes, GymEngine
from tests.support.toy_envs import Broken, Countdown

KEY = 1234567


def rollouts(env: Any = Countdown, num_envs: int | None = 5, **options: Any) -> GymEngine:
    return GymEngine(env, num_envs=num_envs, max_episode_steps=50, **options)


def policy(engine: GymEngine, seed: int = 0, deterministic: bool = False) -> RecurrentPolicy:
    return RecurrentPolicy.for_spaces(
        engine.observation_space,
        engine.action_space,
        PolicyConfig(hidden_size=3, init_range=0.5),
        seed=seed,
        deterministic=deterministic,
    )


def play(engine: GymEngine, n_episodes: int = 23, **options: Any) -> Episodes:
    try:
        return engine.collect(policy(engine), n_episodes, key=KEY, **options)
    finally:
        engine.close()


@pytest.mark.parametrize("num_envs", [1, 4])
def test_an_observation_that_is_not_a_number_is_named_and_the_environments_closed(num_envs: int) -> None:
    made: list[Broken] = []

    def make() -> Broken:
        made.append(Broken("nan"))
        return made[-1]

    message = r"^the environment failed at step 3 of episode \d+, seed \d+: the observation is not finite$"
    with pytest.raises(EnvironmentFailedError, match=message):
        play(rollouts(make, num_envs))
    assert len(made) == num_envs
    assert all(env.closed for env in made)


def test_an_error_of_the_environment_comes_through_and_the_environments_are_closed() -> None:
    made: list[Broken] = []

    def make() -> Broken:
        made.append(Broken("raise"))
        return made[-1]

    engine = rollouts(make)
    message = r"^the environment failed at step 2 of episode \d+, seed \d+: RuntimeError: the motor is on fire$"
    with pytest.raises(EnvironmentFailedError, match=message):
        engine.collect(policy(engine), 10, key=KEY)
    assert all(env.closed for env in made)


class Fragile(Countdown):
    """Fails in some episodes, by their seeds: at the start or in the second step, by raising or by what it gives."""

    def __init__(self, how: str) -> None:
        super().__init__()
        self.how = how

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        observation, info = super().reset(seed=seed)
        self.fails = seed is not None and seed % 3 == 0
        if self.fails and self.how == "reset":
            raise OSError("the motor does not start")
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        observation, reward, *rest = super().step(action)
        if not self.fails or self.left % 2:
            return observation, reward, *rest
        match self.how:
            case "raise":
                raise RuntimeError("the motor is on fire")
            case "nan":
                observation[:] = np.nan
            case "shape":
                observation = np.zeros(2)
            case "reward":
                return observation, [1.0, 2.0], *rest
        return observation, reward, *rest


@pytest.mark.parametrize("how", ["reset", "raise", "nan", "shape", "reward"])
def test_episodes_that_fail_are_played_again_with_another_seed(how: str) -> None:
    """What comes out depends neither on the lanes nor on which other episodes fail."""
    found = []
    for num_envs in (1, 3, 20):
        engine = GymEngine(lambda: Fragile(how), num_envs=num_envs, max_episode_steps=50, on_error="retry")
        with pytest.warns(UserWarning, match=r"^the environment failed at step \d+ of episode \d+, seed \d+, which is"):
            found.append(play(engine))
        assert engine.failures > 0
    for other in found[1:]:
        for name in ("observations", "actions", "rewards", "lengths", "returns"):
            np.testing.assert_array_equal(getattr(found[0], name), getattr(other, name))
    healthy = play(rollouts())
    unhurt = episode_seeds(KEY, np.arange(len(healthy), dtype=np.uint64)) % 3 != 0
    np.testing.assert_array_equal(found[0].returns[unhurt], healthy.returns[unhurt])


def test_an_environment_that_always_fails_is_given_up() -> None:
    engine = GymEngine(lambda: Broken("raise"), num_envs=1, max_episode_steps=50, on_error="retry")
    broken = mock.patch.object(Broken, "step", side_effect=RuntimeError("no"))
    with (
        broken,
        pytest.warns(UserWarning, match="played again"),
        pytest.raises(EnvironmentFailedError, match="RuntimeError: no"),
    ):
        play(engine)


@pytest.mark.parametrize("options", [{"on_error": "ignore"}, {"on_error": "retry", "vectorization": "async"}])
def test_an_unknown_way_with_errors_is_refused(options: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"^on_error must be 'raise'"):
        GymEngine(Countdown, max_episode_steps=9, **options)


@pytest.mark.filterwarnings("ignore:.*ERROR")  # Gymnasium's own words about the process that died
def test_a_failed_asynchronous_environment_is_made_again() -> None:
    engine = GymEngine(partial(Fragile, "raise"), num_envs=2, max_episode_steps=50, vectorization="async")
    try:
        with pytest.raises(EnvironmentFailedError, match="the motor is on fire"):
            play(engine)
        healthy = int(np.flatnonzero(episode_seeds(KEY, np.arange(50, dtype=np.uint64)) % 3 != 0)[0])
        assert len(engine.collect(policy(engine), 1, key=KEY, first_episode=healthy)) == 1
    finally:
        engine.close()


@pytest.mark.parametrize("reward", [np.array([2.0]), np.array(2.0), np.float32(2.0), 2, True, [2.0]])
def test_a_reward_may_be_any_single_number(reward: Any) -> None:
    with mock.patch.object(Countdown, "step", paying(reward)):
        episodes = play(rollouts())
    np.testing.assert_allclose(episodes.returns, float(np.ravel(reward)[0]) * episodes.lengths)


def paying(reward: Any) -> Any:
    step = Countdown.step

    def pays(env: Countdown, action: Any) -> tuple[Any, ...]:
        observation, _, *rest = step(env, action)
        return observation, reward, *rest

    return pays
