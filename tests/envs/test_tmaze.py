from __future__ import annotations

import itertools
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import TimeLimit
from numpy.typing import NDArray

from dpsearch.envs import TMaze
from dpsearch.envs.drawings.tmaze import visible_cells
from dpsearch.envs.tmaze import EAST, ENCODINGS, JUNCTION, NORTH, SIGN_UP, SOUTH, TMazeVector, tmaze_pomdp
from tests.support.exact import machine, memoryless, play

ID = "dpsearch.envs:dpsearch/TMaze-v0"
BITS = {"up": [0, 1, 1], "down": [1, 1, 0], "corridor": [1, 0, 1], "junction": [0, 1, 0]}


class PlainTMaze:
    """The T-maze once more, straight from its definition."""

    def __init__(self, n: int, sign: str) -> None:
        self.n, self.sign, self.position, self.over = n, sign, 0, False

    def step(self, action: int) -> tuple[list[int], float, bool]:
        reward = -0.1
        if action == 1 and self.position < self.n:
            self.position, reward = self.position + 1, 0.0
        elif action == 3 and self.position > 0:
            self.position, reward = self.position - 1, 0.0
        elif action in (0, 2) and self.position == self.n:
            self.over = True
            if (action == 0) == (self.sign == "up"):
                reward = 4.0
        return BITS["junction" if self.position == self.n else "corridor"], reward, self.over


def env_with_sign(sign: str, **arguments: Any) -> TMaze:
    """A T-maze that was reset with a seed that shows this sign."""
    env = TMaze(**arguments)
    for seed in range(64):
        if tuple(env.reset(seed=seed)[0]) == ENCODINGS[env.encoding][sign == "down"]:
            return env
    raise AssertionError


@pytest.mark.parametrize("n", [1, 2, 5, 13])
def test_every_step_is_as_the_definition_says(n: int) -> None:
    env, actions = TMaze(n), np.random.default_rng(n)
    signs = []
    for seed in range(60):
        observation, _ = env.reset(seed=seed)
        sign = {str(bits): name for name, bits in BITS.items()}[str(observation.astype(int).tolist())]
        twin = PlainTMaze(n, sign)
        signs.append(sign)
        for _ in range(100):
            action = int(actions.choice(4, p=[0.05, 0.5, 0.05, 0.4]))
            observation, reward, terminated, truncated, info = env.step(action)
            assert (observation.tolist(), reward, terminated) == twin.step(action)
            assert not truncated
            if terminated:
                break
            assert info["state"] == (sign == "down") * (n + 1) + twin.position
    assert set(signs) == {"up", "down"}


def test_both_signs_are_equally_likely() -> None:
    signs = TMazeVector(num_envs=10_000, corridor_length=2).reset(seed=0)[1]["state"] > 0
    assert abs(signs.mean() - 0.5) < 0.02


def test_the_sign_is_shown_on_the_first_step_only() -> None:
    env = env_with_sign("up", corridor_length=3)
    assert env.step(3)[0].tolist() == BITS["corridor"]  # into the wall, still at position 0
    env.step(EAST)
    assert env.step(3)[0].tolist() == BITS["corridor"]  # back at position 0


@pytest.mark.parametrize("encoding", ["bits", "one_hot"])
def test_observations_are_float32_of_the_encoding_asked_for(encoding: str) -> None:
    env = env_with_sign("down", corridor_length=2, encoding=encoding)
    seen = [env.reset(seed=env.np_random_seed)[0], *[env.step(EAST)[0] for _ in range(2)]]
    assert [tuple(observation.tolist()) for observation in seen] == list(ENCODINGS[encoding][1:])
    assert all(observation.dtype == np.float32 for observation in seen)
    assert env.observation_space == gym.spaces.Box(0, 1, (len(ENCODINGS[encoding][0]),), np.float32)


@pytest.mark.parametrize("n", [1, 3, 10, 500])
@pytest.mark.parametrize("sign", ["up", "down"])
def test_remembering_the_sign_earns_4_in_n_plus_1_steps(n: int, sign: str) -> None:
    env = env_with_sign(sign, corridor_length=n)
    steps = [env.step(EAST) for _ in range(n)] + [env.step(NORTH if sign == "up" else SOUTH)]
    assert env.episode_return == 4.0
    assert env.elapsed_steps == n + 1
    assert [step[2] for step in steps] == [False] * n + [True]


@pytest.mark.parametrize(
    ("n", "printed"),
    [
        (3, "4.00000 1.00000 1.00000 3.76477 4"),
        (5, "4.00000 0.66667 0.66667 3.61568 6"),
        (7, "4.00000 0.50000 0.50000 3.47250 8"),
        (10, "4.00000 0.36364 0.36364 3.26829 11"),
    ],
)
def test_one_bit_of_memory_is_enough_for_the_optimum(n: int, printed: str) -> None:
    def act(memory: tuple[int, int]) -> int:
        sign, symbol = memory
        return EAST if symbol != JUNCTION else NORTH if sign == SIGN_UP else SOUTH

    pomdp = tmaze_pomdp(n)
    optimum = machine(pomdp, lambda symbol: (symbol, symbol), act, lambda memory, symbol: (memory[0], symbol))
    play(pomdp, optimum, 1000).require(printed)


def test_no_policy_without_memory_gets_more_than_1_95() -> None:
    """All 256 deterministic ones, and some others: the junction looks the same after either sign."""
    pomdp, random = tmaze_pomdp(3), np.random.default_rng(0)

    def earns(policy: NDArray[np.float64], limit: int) -> float:
        return play(pomdp, memoryless(policy), limit).mean_return

    returns = [earns(np.eye(4)[list(policy)], 60) for policy in itertools.product(range(4), repeat=4)]
    assert max(returns) == pytest.approx(1.95)
    near = np.array([[0, 1, 0, 0]] * 3 + [[0.5, 0, 0.5, 0]]) * 20 + 0.1
    others = [earns(np.stack([random.dirichlet(row) for row in near]), 1000) for _ in range(50)]
    assert 1.5 < max(others) < 1.95


def test_a_corridor_of_a_hundred_thousand_can_be_walked() -> None:
    env = TMaze(corridor_length=100_000)
    env.reset(seed=0)
    assert env.max_episode_steps == 1_000_010
    for _ in range(300):
        env.step(EAST)
    assert env.kernel_state()[0] % 100_001 == 300
    tables = env.kernel.floats.nbytes + env.kernel.ints.nbytes
    assert tables < 64 * 2**20


@pytest.mark.parametrize("length", [0, -1, 100_001, 2.0, 10.5, "10", None, True])
def test_a_corridor_of_impossible_length_is_refused(length: Any) -> None:
    expected = f"corridor_length must be a whole number from 1 to 100000, got {length!r}"
    for make in (TMaze, TMazeVector, lambda corridor_length: gym.make(ID, corridor_length=corridor_length)):
        with pytest.raises(ValueError, match=expected):
            make(corridor_length=length)


def test_an_unknown_encoding_is_refused() -> None:
    with pytest.raises(ValueError, match="encoding must be one of bits, one_hot, got 'hex'"):
        TMaze(encoding="hex")


def last_step(env: gym.Env[Any, Any]) -> int:
    """The step at which an episode of bumping into the wall is cut off."""
    env.reset(seed=0)
    for t in range(1, 10_000):
        if env.step(NORTH)[3]:
            return t
    raise AssertionError


@pytest.mark.parametrize(("n", "limit"), [(10, 1000), (99, 1000), (100, 1010), (500, 5010)])
def test_the_limit_grows_with_the_corridor(n: int, limit: int) -> None:
    env = gym.make(ID, corridor_length=n)
    assert isinstance(env.unwrapped, TMaze)
    assert env.unwrapped.max_episode_steps == limit
    assert env.spec is not None
    assert env.spec.max_episode_steps == limit
    assert env.spec.reward_threshold == 3.8
    assert last_step(env) == limit
    vector = gym.make_vec(ID, num_envs=2, corridor_length=n).unwrapped
    assert isinstance(vector, TMazeVector)
    assert vector.max_episode_steps == limit


def test_a_limit_given_to_make_holds() -> None:
    env = gym.make(ID, corridor_length=500, max_episode_steps=77)
    assert env.spec is not None
    assert env.spec.max_episode_steps == 77
    assert last_step(env) == 77
    assert last_step(TimeLimit(TMaze(500), 78)) == 78
    assert last_step(TMaze(500, max_episode_steps=79)) == 79
    vector = gym.make_vec(ID, num_envs=2, corridor_length=500, max_episode_steps=77)
    vector.reset(seed=0)
    cut = [vector.step(np.zeros(2, np.int64))[3].all() for _ in range(77)]
    assert cut == [False] * 76 + [True]


def test_an_environment_can_be_made_again_from_its_spec() -> None:
    env = gym.make(ID, corridor_length=200, encoding="one_hot")
    assert env.spec is not None
    again = gym.make(env.spec)
    assert isinstance(again.unwrapped, TMaze)
    assert again.unwrapped.corridor_length == 200
    assert again.observation_space == env.observation_space
    assert last_step(again) == 2010
    vector = gym.make_vec(env.spec, num_envs=2).unwrapped
    assert isinstance(vector, TMazeVector)
    assert vector.max_episode_steps == 2010


@pytest.mark.parametrize("render_mode", [None, "rgb_array", "human", "ansi"])
def test_gymnasiums_checks_pass_in_every_render_mode(render_mode: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setitem(TMaze.metadata, "render_fps", 1000)
    check_env(gym.make(ID, render_mode=render_mode).unwrapped)


def picture(env: TMaze) -> NDArray[np.uint8]:
    frame = env.render()
    assert isinstance(frame, np.ndarray)
    assert frame.shape == (540, 960, 3)
    assert frame.dtype == np.uint8
    return frame


def test_pictures_show_sign_agent_and_outcome() -> None:
    frames: dict[tuple[str, str], NDArray[np.uint8]] = {}
    for sign in ("up", "down"):
        env = env_with_sign(sign, corridor_length=3, render_mode="rgb_array")
        frames[sign, "start"] = picture(env)
        for t in range(3):
            env.step(EAST)
            frames[sign, f"step {t}"] = picture(env)
        env.step(NORTH)
        frames[sign, "end"] = picture(env)
    for (name, one), (other, two) in itertools.combinations(frames.items(), 2):
        assert (one != two).any(), (name, other)


def test_a_picture_is_a_function_of_the_moment() -> None:
    one, two = (env_with_sign("up", corridor_length=40, render_mode="rgb_array") for _ in range(2))
    for _ in range(3):
        one.step(EAST)
        two.step(EAST)
        assert (picture(one) == picture(two)).all()


@pytest.mark.parametrize("n", [1, 5, 12, 13, 14, 30, 1000])
def test_a_drawn_corridor_shows_its_ends_and_the_surroundings_of_the_agent(n: int) -> None:
    counts = set()
    for position in range(n + 1):
        cells = visible_cells(n, position)
        counts.add(len(cells))
        shown = [cell for cell in cells if cell is not None]
        assert shown == sorted(set(shown))
        near = range(max(position - 2, 0), min(position + 2, n) + 1)
        assert {0, n, *near} <= set(shown)
        for before, gap, after in zip(cells, cells[1:], cells[2:], strict=False):
            if gap is None:
                assert before is not None
                assert after is not None
                assert after - before > 2  # a gap hides more than one cell
            elif before is not None:
                assert gap == before + 1
    assert len(counts) == 1
    assert counts.pop() <= 13


def test_text_tells_the_story() -> None:
    env = env_with_sign("down", corridor_length=4, render_mode="ansi")
    start = env.render()
    assert "The road sign points down. It is shown only now." in start
    assert "sees sign down (1 1 0), last action none, step 0 of 1000, return 0.0" in start
    assert start.splitlines()[1].startswith(" A . . . .|")
    env.step(NORTH)
    env.step(EAST)
    assert " S A . . .|" in env.render()
    assert "last action east, step 2 of 1000, return -0.1" in env.render()
    for _ in range(3):
        env.step(EAST)
    assert "Which way did the sign point?" in env.render()
    env.step(NORTH)
    assert "The sign pointed down, the agent turned north: wrong, -0.1." in env.render()
    assert env.render().splitlines()[0].strip() == "A -0.1"
    env = env_with_sign("down", corridor_length=1, render_mode="ansi", max_episode_steps=1)
    env.step(NORTH)
    assert "Time is up." in env.render()


def test_nothing_is_drawn_without_a_render_mode() -> None:
    env = TMaze()
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="nothing is drawn unless"):
        assert env.render() is None


def test_a_window_opens_shows_every_step_and_closes(monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = pytest.importorskip("pygame")
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setitem(TMaze.metadata, "render_fps", 1000)
    env = env_with_sign("up", render_mode="human")
    before = pygame.surfarray.array3d(pygame.display.get_surface())
    env.step(EAST)
    after = pygame.surfarray.array3d(pygame.display.get_surface())
    assert after.shape == (960, 540, 3)
    assert (before != after).any()
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    env.step(EAST)  # the user has closed the window: the episode goes on unseen
    assert not pygame.display.get_init()
    env.step(EAST)
    assert env.render() is None
    env.close()
    env.close()


def test_a_missing_pygame_is_named_with_the_command_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pygame", None)
    with pytest.raises(gym.error.DependencyNotInstalled, match=r'pip install "dpsearch\[render\]"'):
        TMaze(render_mode="human")
