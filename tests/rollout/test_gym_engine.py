import warnings
from collections.abc import Callable
from contextlib import closing
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from dpsearch.envs import TMaze
from dpsearch.kernels.philox import episode_seeds
from dpsearch.policies import PolicyConfig, RecurrentPolicy, UnsupportedSpaceError
from dpsearch.rollout import Episodes, GymEngine, make_rollouts
from tests.support.toy_envs import LONG, SHORT, Countdown

KEY = 1234567
CAP = 50


def rollouts(env: Any = Countdown, num_envs: int | None = 5, **options: Any) -> GymEngine:
    return GymEngine(env, num_envs=num_envs, max_episode_steps=CAP, **options)


def vector_env(mode: AutoresetMode, num_envs: int, make: Callable[[], Any] = Countdown) -> SyncVectorEnv:
    return SyncVectorEnv([make] * num_envs, autoreset_mode=mode)


def policy(engine: GymEngine, seed: int = 0, deterministic: bool = False) -> RecurrentPolicy:
    return RecurrentPolicy.for_spaces(
        engine.observation_space,
        engine.action_space,
        PolicyConfig(hidden_size=3, init_range=0.5),
        seed=seed,
        deterministic=deterministic,
    )


def assert_same(a: Episodes, b: Episodes) -> None:
    for name in ("observations", "actions", "rewards", "lengths", "terminated", "returns"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def play(engine: GymEngine, n_episodes: int = 23, **options: Any) -> Episodes:
    try:
        return engine.collect(policy(engine), n_episodes, key=KEY, **options)
    finally:
        engine.close()


def test_the_same_call_brings_the_same_episodes() -> None:
    engine = rollouts()
    assert_same(play(engine), play(engine))
    assert_same(play(rollouts()), play(rollouts()))


@pytest.mark.parametrize("num_envs", [1, 2, 17, 40])
def test_episodes_do_not_depend_on_how_many_are_played_side_by_side(num_envs: int) -> None:
    assert_same(play(rollouts(num_envs=num_envs)), play(rollouts()))


def test_episodes_do_not_depend_on_how_they_are_split_into_calls() -> None:
    whole, part = play(rollouts(), 20), play(rollouts(), 8, first_episode=5)
    steps = len(part.rewards)
    np.testing.assert_array_equal(part.lengths, whole.lengths[5:13])
    np.testing.assert_array_equal(part.observations, whole.observations[:steps, 5:13])
    np.testing.assert_array_equal(part.actions, whole.actions[:steps, 5:13])


def test_processes_bring_the_same_episodes_as_a_loop() -> None:
    assert_same(play(rollouts(num_envs=2, vectorization="async")), play(rollouts()))


def test_recorded_episodes_are_those_of_the_environment() -> None:
    episodes = play(rollouts())
    env = Countdown()
    for b, seed in enumerate(episode_seeds(KEY, np.arange(23, dtype=np.uint64))):
        observation, _ = env.reset(seed=int(seed))
        assert episodes.lengths[b] == env.left
        for t in range(episodes.lengths[b]):
            np.testing.assert_array_equal(episodes.observations[t, b], observation)
            observation, reward, terminated, _, _ = env.step(np.int64(episodes.actions[t, b, 0]))
            assert episodes.rewards[t, b] == reward
        assert terminated == episodes.terminated[b]
    np.testing.assert_array_equal(episodes.returns, episodes.rewards.sum(axis=0))


def test_both_ways_of_autoreset_bring_the_same_episodes() -> None:
    for num_envs in (1, 3):
        next_step, same_step = (
            play(rollouts(vector_env(mode, num_envs), None), 20)
            for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)
        )
        assert_same(next_step, same_step)
        assert set(next_step.lengths) == {SHORT, LONG}


def test_the_row_after_the_end_is_no_step_of_an_episode() -> None:
    episodes = play(rollouts(vector_env(AutoresetMode.NEXT_STEP, 1), None), 20)
    env = Countdown()
    env.reset(seed=int(episode_seeds(KEY, np.zeros(1, np.uint64))[0]))
    for b, length in enumerate(episodes.lengths):
        assert length == env.left
        np.testing.assert_array_equal(episodes.observations[:length, b, 0], np.arange(length, 0, -1))
        env.reset()


def test_a_lane_of_a_vector_environment_does_not_depend_on_the_others() -> None:
    short, long = (play(rollouts(vector_env(AutoresetMode.NEXT_STEP, 3), None), n) for n in (5, 20))
    np.testing.assert_array_equal(short.lengths, long.lengths[:5])
    np.testing.assert_array_equal(short.returns, long.returns[:5])


def test_a_vector_environment_that_is_not_reset_is_refused_in_one_line() -> None:
    with pytest.raises(ValueError, match=r"^autoreset mode .*DISABLED is not supported: NEXT_STEP and SAME_STEP are$"):
        rollouts(vector_env(AutoresetMode.DISABLED, 2), None)


def test_a_vector_class_that_takes_a_single_seed_plays_too() -> None:
    options: dict[str, Any] = {"num_envs": 3, "vectorization": "vector_entry_point"}
    engine = GymEngine("CartPole-v1", max_episode_steps=15, **options)
    assert (engine.max_steps, engine.reward_threshold) == (15, 475.0)
    episodes = play(engine)
    assert (episodes.rewards[episodes.mask] == 1.0).all()
    assert set(episodes.terminated) == {True, False}
    assert (episodes.lengths[~episodes.terminated] == 15).all()
    assert_same(play(GymEngine("CartPole-v1", max_episode_steps=15, **options)), episodes)


@pytest.mark.parametrize("way", ["loop", "next step", "same step"])
def test_long_episodes_count_as_often_as_short_ones(way: str) -> None:
    if way == "loop":
        engine = rollouts(num_envs=32)
    else:
        mode = AutoresetMode.NEXT_STEP if way == "next step" else AutoresetMode.SAME_STEP
        engine = rollouts(vector_env(mode, 32), None)
    episodes = play(engine, 400, record=False)
    assert set(episodes.lengths) == {SHORT, LONG}
    assert abs((episodes.lengths == LONG).mean() - 0.5) < 3 * 0.5 / np.sqrt(400)


@pytest.mark.parametrize("n_episodes", [1, 5, 6, 40])
def test_it_plays_as_many_episodes_as_asked_for_and_pads_with_zeros(n_episodes: int) -> None:
    episodes = play(rollouts(), n_episodes)
    longest = episodes.lengths.max()
    assert len(episodes) == n_episodes
    assert episodes.observations.shape == (longest, n_episodes, 1)
    assert episodes.actions.shape == (longest, n_episodes, 1)
    assert episodes.rewards.shape == (longest, n_episodes)
    for array in (episodes.observations, episodes.actions, episodes.rewards):
        assert array.dtype == np.float32
        assert not array[~episodes.mask].any()
    assert (episodes.observations[episodes.mask] > 0).all()


def test_without_a_record_the_outcome_is_the_same() -> None:
    recorded, outcome = play(rollouts()), play(rollouts(), record=False)
    assert (len(outcome.observations), len(outcome.actions), len(outcome.rewards)) == (0, 0, 0)
    np.testing.assert_array_equal(outcome.returns, recorded.returns)
    np.testing.assert_array_equal(outcome.lengths, recorded.lengths)


def test_both_engines_play_the_same_t_maze() -> None:
    lanes = make_rollouts("dpsearch/TMaze-v0", env_kwargs={"corridor_length": 3}, max_episode_steps=CAP)
    vector = rollouts(partial(TMaze, 3))
    network = policy(vector)
    a, b = (engine.collect(network, 200, key=KEY) for engine in (lanes, vector))
    sign = a.observations[0, :, 2]
    assert abs(sign.mean() - 0.5) < 3 * 0.5 / np.sqrt(200)
    assert abs(b.observations[0, :, 2].mean() - 0.5) < 3 * 0.5 / np.sqrt(200)
    spread = np.sqrt((a.returns.var() + b.returns.var()) / 200)
    assert abs(a.returns.mean() - b.returns.mean()) < 3 * spread
    # The engines draw the sign in their own ways, the actions from the same numbers: where the signs are
    # equal, so is everything else.
    same = sign == b.observations[0, :, 2]
    assert 50 < same.sum() < 150
    for name in ("lengths", "terminated", "returns"):
        np.testing.assert_array_equal(getattr(a, name)[same], getattr(b, name)[same])
    for name in ("observations", "actions", "rewards"):
        np.testing.assert_array_equal(getattr(a, name)[:, same], getattr(b, name)[:, same])


def test_candidates_play_as_their_weights_would_alone() -> None:
    engine = rollouts()
    candidates = [policy(engine, seed) for seed in range(7)]
    numbers = np.arange(21).reshape(7, 3) + 100
    population = np.stack([candidate.vector() for candidate in candidates])
    returns, lengths = engine.evaluate(candidates[0], population, key=KEY, episodes=numbers)
    for i, candidate in enumerate(candidates):
        alone = engine.collect(candidate, 3, key=KEY, first_episode=100 + 3 * i)
        np.testing.assert_array_equal(lengths[i], alone.lengths)
        np.testing.assert_array_equal(returns[i], alone.returns)


def test_equal_candidates_with_equal_episode_numbers_have_equal_returns() -> None:
    engine = rollouts()
    population = np.tile(policy(engine).vector(), (6, 1))
    returns, _ = engine.evaluate(policy(engine), population, key=KEY, episodes=np.tile([3, 8], (6, 1)))
    assert (returns == returns[0]).all()


def test_a_greedy_policy_draws_no_noise() -> None:
    engine = rollouts()
    network = policy(engine)
    first, second = (engine.collect(network, 9, key=KEY, first_episode=k, greedy=True) for k in (0, 9))
    for length in (SHORT, LONG):
        plays = [e.actions[:length, b] for e in (first, second) for b in np.flatnonzero(e.lengths == length)]
        assert len(plays) > 3
        np.testing.assert_array_equal(plays, [plays[0]] * len(plays))


@pytest.mark.parametrize(
    "observed",
    [
        spaces.Discrete(4, start=2),
        spaces.MultiDiscrete([2, 3]),
        spaces.Box(-1, 1, (2, 2)),
        spaces.Tuple([spaces.Discrete(2), spaces.MultiBinary(3)]),
    ],
    ids=str,
)
def test_any_observation_is_seen_as_gymnasium_flattens_it(observed: gym.Space[Any]) -> None:
    make = partial(Countdown, observed=observed)
    loop, vector = rollouts(make), rollouts(SyncVectorEnv([make] * 5), None)
    flat: Any = spaces.flatten_space(loop.observation_space)
    assert loop.observation_size == vector.observation_size == flat.shape[0]
    episodes = play(loop, 5)
    assert all(flat.contains(row) for row in episodes.observations[episodes.mask].astype(flat.dtype))
    assert_same(play(vector, 5), episodes)


@pytest.mark.parametrize(
    "space", [spaces.Discrete(3, start=4), spaces.MultiDiscrete([2, 3])], ids=["Discrete", "MultiDiscrete"]
)
def test_discrete_actions_are_those_of_the_space(space: gym.Space[Any]) -> None:
    env = Countdown(space)
    episodes = play(rollouts(env, None), 10)
    chosen = episodes.actions.swapaxes(0, 1)[episodes.mask.T]
    offset = 4 if isinstance(space, spaces.Discrete) else 0
    assert chosen.min() == 0
    np.testing.assert_array_equal(np.reshape(env.actions, chosen.shape), chosen + offset)


def test_actions_for_a_box_are_scaled_and_clipped_but_recorded_as_they_were() -> None:
    env = Countdown(spaces.Box(np.array([0, -3], np.float32), np.array([10, 1], np.float32)))
    episodes = play(rollouts(env, None), 20)
    chosen = episodes.actions.swapaxes(0, 1)[episodes.mask.T]
    assert np.abs(chosen).max() > 1
    clipped = chosen.clip(-1, 1)
    expected = np.stack([5 + 5 * clipped[:, 0], -1 + 2 * clipped[:, 1]], axis=1)
    np.testing.assert_allclose(env.actions, expected, atol=1e-5)


def test_actions_for_an_unbounded_box_are_taken_as_they_are() -> None:
    env = Countdown(spaces.Box(-np.inf, np.inf, (1,)))
    episodes = play(rollouts(env, None), 20)
    chosen = episodes.actions.swapaxes(0, 1)[episodes.mask.T]
    np.testing.assert_array_equal(np.stack(env.actions), chosen)


def test_a_deterministic_policy_stays_within_the_box() -> None:
    engine = rollouts(partial(Countdown, spaces.Box(-1, 1, (1,))))
    episodes = engine.collect(policy(engine, deterministic=True), 10, key=KEY)
    assert np.abs(episodes.actions).max() < 1


@pytest.mark.parametrize("vectorization", ["sync", "async"])
def test_a_step_limit_cuts_episodes_off(vectorization: str) -> None:
    engine = GymEngine(Countdown, num_envs=2, max_episode_steps=7, vectorization=vectorization)  # type: ignore[arg-type]
    assert engine.max_steps == 7
    episodes = play(engine)
    np.testing.assert_array_equal(episodes.lengths, np.where(episodes.terminated, SHORT, 7))
    assert set(episodes.lengths) == {SHORT, 7}


def test_a_vector_environment_that_cannot_be_cut_off_is_an_error_not_a_wrong_result() -> None:
    engine = GymEngine(vector_env(AutoresetMode.NEXT_STEP, 2), max_episode_steps=7)
    with pytest.raises(ValueError, match="goes on after 7 steps"):
        play(engine)


def test_an_environment_without_a_step_limit_gets_one_with_a_warning() -> None:
    with pytest.warns(UserWarning, match="^max_episode_steps is taken to be 1000: "):
        assert GymEngine(Countdown).max_steps == 1000


@pytest.mark.parametrize("claimed", [-1, 0, None, True, 2.5, "9"])
@pytest.mark.parametrize("given", [None, 20])
def test_a_limit_that_is_no_positive_number_is_none(claimed: Any, given: int | None) -> None:
    def make() -> Countdown:
        env = Countdown()
        env.max_episode_steps = claimed  # type: ignore[attr-defined]
        return env

    if given is None:
        with pytest.warns(UserWarning, match="max_episode_steps"):
            engine = GymEngine(make)
    else:
        engine = GymEngine(make, max_episode_steps=given)
    assert engine.max_steps == (1000 if given is None else given)
    assert set(play(engine).lengths) == {SHORT, LONG}


@pytest.mark.parametrize("mode", ["sync", "async"])
def test_a_ready_vector_environment_may_have_another_limit_than_its_id(mode: str) -> None:
    vector = gym.make_vec("CartPole-v1", num_envs=2, vectorization_mode=mode, max_episode_steps=600)
    with closing(vector):
        assert GymEngine(vector).max_steps == 600


def test_environments_are_made_once_and_closed_once() -> None:
    made: list[Countdown] = []

    def make() -> Countdown:
        made.append(Countdown())
        return made[-1]

    engine = rollouts(make, 4)
    for n_episodes in (2, 9, 3):
        engine.collect(policy(engine), n_episodes, key=KEY)
    assert len(made) == 4
    assert not any(env.closed for env in made)
    engine.close()
    assert all(env.closed for env in made)


def test_what_came_ready_is_left_open() -> None:
    env = Countdown()
    play(rollouts(env, None))
    assert not env.closed
    vector = vector_env(AutoresetMode.NEXT_STEP, 2)
    play(rollouts(vector, None))
    assert not vector.closed


@pytest.mark.parametrize(
    ("kind", "space"),
    [("action", spaces.MultiBinary(2)), ("observation", spaces.Sequence(spaces.Discrete(2)))],
)
def test_an_unsupported_space_is_refused_before_anything_is_played(kind: str, space: gym.Space[Any]) -> None:
    made: list[Countdown] = []

    def make() -> Countdown:
        made.append(Countdown())
        setattr(made[-1], f"{kind}_space", space)
        return made[-1]

    with pytest.raises(UnsupportedSpaceError, match=rf"^{kind} space .* is not supported"):
        rollouts(make)
    assert [env.closed for env in made] == [True]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"num_envs": 0}, "num_envs must be at least 1"),
        ({"max_episode_steps": 0}, "max_episode_steps must be at least 1"),
        ({"vectorization": "magic"}, "vectorization must be"),
        ({"vectorization": "vector_entry_point"}, "needs an id or a spec"),
    ],
)
def test_an_option_out_of_range_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        GymEngine(Countdown, **options)


def test_a_ready_environment_cannot_be_multiplied() -> None:
    for options in ({"num_envs": 2}, {"env_kwargs": {"observed": None}}, {"vectorization": "async"}):
        with pytest.raises(ValueError, match="give a factory"):
            GymEngine(Countdown(), max_episode_steps=CAP, **options)


def test_a_policy_that_does_not_fit_is_refused() -> None:
    engine = rollouts()
    other = rollouts(partial(Countdown, spaces.MultiDiscrete([2, 2])))
    with pytest.raises(ValueError, match="maps 1 observations to 2 actions, the environment has 1 and 1"):
        engine.collect(policy(other), 1, key=KEY)
    with pytest.raises(ValueError, match="n_episodes"):
        engine.collect(policy(engine), 0, key=KEY)


@pytest.mark.parametrize("scale", [1e-6, 1e-3, 0.1, 1.0, 20.0, 1e3, 1e6])
def test_observations_far_from_1_are_warned_of_once(scale: float) -> None:
    def make() -> gym.Env[Any, Any]:
        return gym.wrappers.TransformObservation(
            Countdown(), lambda seen: seen * scale / LONG, Countdown().observation_space
        )

    engine = rollouts(make)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        play(engine)
        play(engine)
    sizes = [str(warning.message) for warning in said if "observations are of size" in str(warning.message)]
    assert len(sizes) == (0 if 0.01 <= scale <= 100.0 else 1)
