"""Drawings of finite POMDPs: that they can be made, tell what goes on, and give nothing away."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray

from dpsearch.envs import (
    CheeseMaze,
    Maze4x3,
    Maze89,
    ShuttleDocking,
    Tiger,
    TMaze,
    cheese_maze,
    maze4x3,
    maze89,
    shuttle,
    tiger,
    tmaze,
)
from dpsearch.pomdp import BeliefFilter, TabularEnv
from dpsearch.pomdp.env import REVEALED, Moment
from dpsearch.pomdp.grid import Grid

Kind = tuple[type[TabularEnv], dict[str, Any]]
KINDS: list[Kind] = [
    (TMaze, {"corridor_length": 3}),
    (Tiger, {}),
    (Tiger, {"single": True}),
    (ShuttleDocking, {}),
    (CheeseMaze, {"start": "anywhere"}),
    (Maze4x3, {}),
    (Maze4x3, {"minus_ends": True}),
    (Maze4x3, {"slips": "any_way", "minus_reward": -0.04}),
    (Maze89, {}),
]
NAMES = [kind.__name__ + "".join(f" {name}" for name in arguments) for kind, arguments in KINDS]
Drawn = tuple[bytes, str]


@pytest.fixture(params=KINDS, ids=NAMES)
def kind(request: pytest.FixtureRequest) -> Kind:
    chosen: Kind = request.param
    return chosen


def make(kind: Kind, **arguments: Any) -> TabularEnv:
    env = gym.make(f"dpsearch.envs:dpsearch/{kind[0].__name__}-v0", **kind[1], **arguments).unwrapped
    assert isinstance(env, kind[0])
    return env


def drawn(env: TabularEnv, moment: Moment) -> Drawn:
    """Picture and text of any moment."""
    with patch.object(env, "moment", return_value=moment):
        frame, text = env.picture(), env.text()
    assert frame.shape == (540, 960, 3)
    assert frame.dtype == np.uint8
    return frame.tobytes(), text


def told(kind: type[TabularEnv], before: int | None, action: int | None, now: int, **changes: Any) -> str:
    """The text of a moment in which an action has led from one state to another."""
    arguments: dict[str, Any] = {
        name: changes.pop(name)
        for name in ("single", "minus_ends", "minus_reward", "corridor_length")
        if name in changes
    }
    env = make((kind, arguments), render_mode="ansi")
    env.reset(seed=0)
    symbol = env.moment().symbol if action is None else int(env.pomdp.observation_matrix(action)[now].argmax())
    at = {"state": now, "last_state": before, "last_action": action, "step": int(action is not None), "symbol": symbol}
    return drawn(env, replace(env.moment(), **{"last_reward": 0.0, **at, **changes}))[1]


def playing(kind: Kind, seed: int, steps: int, **arguments: Any) -> Iterator[Moment]:
    """The moments of an episode; the actions are the same for all seeds."""
    env = make(kind, render_mode="ansi", **arguments)
    env.reset(seed=seed)
    yield env.moment()
    for action in np.random.default_rng(5).integers(env.pomdp.n_actions, size=steps):
        ended = env.step(action)[2]
        yield env.moment()
        if ended:
            return


@pytest.mark.parametrize("reveal", REVEALED)
@pytest.mark.parametrize("render_mode", ["rgb_array", "human", "ansi"])
def test_gymnasiums_checks_pass_in_every_mode(
    kind: Kind, render_mode: str, reveal: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setitem(TabularEnv.metadata, "render_fps", 1000)
    env = make(kind, render_mode=render_mode, reveal=reveal)
    check_env(env)
    env.close()


@pytest.mark.parametrize("reveal", ["state", "belief"])
def test_pictures_and_texts_show_the_state(kind: Kind, reveal: str) -> None:
    env = make(kind, render_mode="ansi", reveal=reveal)
    env.reset(seed=0)
    states = np.flatnonzero(~env.pomdp.terminal)[:40].tolist()
    shown = [drawn(env, replace(env.moment(), state=state)) for state in states]
    assert len({frame for frame, _ in shown}) == len(states)
    assert len({text for _, text in shown}) == len(states)


def test_nothing_gives_the_state_away_if_it_is_to_stay_hidden(kind: Kind) -> None:
    """Neither the present state nor the last one, nor what was earned there."""
    random = np.random.default_rng(0)
    *_, moment = playing(kind, 1, 2, reveal="nothing")
    env = make(kind, render_mode="ansi", reveal="nothing")
    length = kind[1].get("corridor_length")
    states = range(env.pomdp.n_states)
    alike = [  # a T-maze's position is no secret
        state
        for state in states
        if env.pomdp.terminal[state] == moment.terminated
        and (length is None or (state - moment.state) % (length + 1) == 0)
    ]
    assert len(alike) > 1
    shown = {
        drawn(env, replace(moment, state=state, last_state=random.choice(states), last_reward=r, episode_return=r))
        for state in alike[:20]
        for r in (-100.0, 10.0)
    }
    assert len(shown) == 1


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind[0] is not TMaze], ids=NAMES[1:], indirect=True)
def test_equal_histories_look_equal_if_the_state_is_to_stay_hidden(
    kind: Kind,
) -> None:
    env = make(kind, render_mode="ansi", reveal="nothing")
    moments: dict[tuple[Any, ...], dict[int, Moment]] = defaultdict(dict)  # history -> state -> moment
    for seed in range(60):
        history: tuple[Any, ...] = ()
        for moment in playing(kind, seed, 5, reveal="nothing"):
            history = (*history, moment.symbol, moment.terminated)
            moments[history][moment.state] = moment
    open_histories = [list(alike.values()) for alike in moments.values() if len(alike) > 1]
    assert open_histories
    for alike in open_histories[:6]:
        assert len({drawn(env, moment) for moment in alike[:4]}) == 1


def test_texts_tell_the_belief(kind: Kind) -> None:
    """Bayes' rule, once more from the filter, which leaves out that the agent notices the end of an episode."""
    words = {TMaze: ("up", "down"), Tiger: ("tiger left", "right")}.get(kind[0])
    belief: NDArray[np.float64] | None = None
    for moment in playing(kind, 3, 25, reveal="belief"):
        pomdp = moment.pomdp
        if belief is None:
            belief = BeliefFilter(pomdp).start([moment.symbol])[0]
        else:
            assert moment.last_action is not None
            belief = BeliefFilter(pomdp).update(belief[None], [moment.last_action], [moment.symbol])[0]
            belief = np.where(pomdp.terminal == moment.terminated, belief, 0)
            belief /= belief.sum()
        assert moment.belief is not None
        np.testing.assert_allclose(moment.belief, belief, atol=1e-12)
        env = make(kind, render_mode="ansi", reveal="belief")
        line = drawn(env, moment)[1].splitlines()[-1]
        assert line.startswith(" belief: ")
        if words is None:
            parts = [part.rsplit(" ", 1) for part in line.removeprefix(" belief: ").split("; ")]
            expected = dict(zip(pomdp.state_names, belief, strict=True))
            expected["others"] = 1 - sum(expected[name] for name, _ in parts if name != "others")
        else:
            parts = [[word, line.split(f"{word} ")[1].split(",")[0]] for word in words]
            first = range(0, pomdp.n_states, 2) if kind[0] is Tiger else [*range(4), 8, 9]
            expected = dict(zip(words, (belief[first].sum(), 1 - belief[first].sum()), strict=True))
        assert parts
        for name, shown in parts:
            assert float(shown.removesuffix("%")) / 100 == pytest.approx(expected[name], abs=0.00051)


def test_pictures_show_the_belief(kind: Kind) -> None:
    *_, moment = playing(kind, 0, 1, reveal="belief")
    env = make(kind, render_mode="ansi", reveal="belief")
    states = np.flatnonzero(moment.pomdp.terminal == moment.terminated)
    beliefs = [np.eye(moment.pomdp.n_states)[state] for state in states[[0, -1]]]
    beliefs.append((beliefs[0] + beliefs[1]) / 2)
    assert len({drawn(env, replace(moment, belief=belief))[0] for belief in beliefs}) == 3


def test_beliefs_of_large_models_are_refused() -> None:
    TMaze(corridor_length=2497, reveal="belief")
    with pytest.raises(ValueError, match=r'reveal="belief" is for models of up to 5,000 states, this one has 5,002'):
        TMaze(corridor_length=2498, reveal="belief")
    with pytest.raises(ValueError, match="reveal must be one of state, belief, nothing, got 'all'"):
        TMaze(reveal="all")


def test_an_episode_that_goes_on_is_not_at_its_end() -> None:
    """The dead ends of the cheese maze look alike, but in one of them the cheese would have ended the episode."""
    for seed in range(100):
        env = CheeseMaze(start="anywhere", render_mode="ansi", reveal="belief")
        env.reset(seed=seed)
        if env.step(cheese_maze.ACTIONS.index("south"))[2] or env.moment().sees != "walls east, south, west":
            continue
        belief = env.moment().belief
        assert belief is not None
        assert belief[cheese_maze.CHEESE] == 0
        assert belief.sum() == pytest.approx(1)
        return
    raise AssertionError


def test_a_tmaze_shows_its_sign_to_those_who_may_know_it() -> None:
    for reveal, sign in (("state", "up"), ("belief", "up"), ("nothing", "?")):
        arguments = {"corridor_length": 3, "reveal": reveal, "symbol": tmaze.CORRIDOR}
        walking = told(TMaze, 0, tmaze.EAST, 1, **arguments)
        assert f" sign {sign}, sees corridor" in walking
        assert "out of sight" in walking
    start = told(TMaze, None, None, 0, corridor_length=3, reveal="nothing", symbol=tmaze.SIGN_UP)
    assert "The road sign points up. It is shown only now." in start
    assert start.splitlines()[0].strip() == "+4"
    end = told(TMaze, 3, tmaze.NORTH, 8, corridor_length=3, reveal="nothing")
    assert "The agent turned north." in end
    assert end.splitlines()[0].strip() == "A ?"
    assert "return hidden" in end


def test_the_tiger_is_heard_and_met() -> None:
    listened = {"symbol": tiger.HEARD_LEFT}
    assert "[ treasure ] [  tiger   ]  Nothing was heard yet" in told(Tiger, None, None, 1)
    assert "Growling was heard behind the left door." in told(Tiger, 0, tiger.LISTEN, 0, **listened)
    assert "behind the left door: misheard." in told(Tiger, 1, tiger.LISTEN, 1, **listened)
    assert "behind the left door." in told(Tiger, 1, tiger.LISTEN, 1, reveal="nothing", **listened)
    met = told(Tiger, 1, tiger.OPEN_RIGHT, 0, last_reward=-100.0)
    assert "It opened the right door: the tiger was there, -100. Then the tiger was placed anew." in met
    found = told(Tiger, 1, tiger.OPEN_LEFT, 3, last_reward=10.0, single=True)
    assert "It opened the left door: the treasure was there, +10.\n" in found
    hidden = told(Tiger, 1, tiger.OPEN_LEFT, 3, last_reward=10.0, single=True, reveal="nothing")
    assert "[    ?     ] [    ?     ]  It opened the left door.\n" in hidden
    assert "Time is up." in told(Tiger, 0, tiger.LISTEN, 0, step=100, **listened)


@pytest.mark.parametrize(
    ("before", "action", "now", "reward", "message"),
    [
        (3, shuttle.BACK_UP, 0, 10.0, "LRV [> . . . .] MRV  It docked at the least recently visited station: +10."),
        (4, shuttle.BACK_UP, 7, 0.0, "LRV [. . . . <] MRV  It docked where it had been last"),
        (6, shuttle.GO_FORWARD, 6, -3.0, "LRV [. < . . .] MRV  It bumped into the station ahead: -3."),
        (0, shuttle.GO_FORWARD, 4, 0.0, "It left the dock. Its station is now the one visited last."),
        (7, shuttle.GO_FORWARD, 4, 0.0, "It left the dock.\n"),
        (7, shuttle.TURN_AROUND, 1, 0.0, "It left the dock and turned to face the station.\n"),
        (7, shuttle.BACK_UP, 7, 0.0, "It backed up in the dock, and stays there."),
        (5, shuttle.TURN_AROUND, 2, 0.0, "It turned around."),
        (4, shuttle.GO_FORWARD, 5, 0.0, "It flew out into space."),
        (5, shuttle.GO_FORWARD, 6, 0.0, "It approached the station ahead."),
        (3, shuttle.BACK_UP, 3, 0.0, "It tried to dock but stayed where it was."),
        (1, shuttle.BACK_UP, 1, 0.0, "It tried to back up but stayed where it was."),
        (1, shuttle.BACK_UP, 4, 0.0, "It tried to back up but was turned around."),
        (1, shuttle.BACK_UP, 2, 0.0, "It backed out into space."),
        (2, shuttle.BACK_UP, 2, 0.0, "It tried to back up but stayed where it was."),
        (2, shuttle.BACK_UP, 3, 0.0, "It backed to the station behind it.\n"),
        (2, shuttle.BACK_UP, 6, 0.0, "It backed to the station behind it but was turned around."),
    ],
)
def test_a_shuttle_tells_what_it_does(before: int, action: int, now: int, reward: float, message: str) -> None:
    assert message in told(ShuttleDocking, before, action, now, last_reward=reward)


@pytest.mark.parametrize(
    ("symbol", "message"),
    [
        (shuttle.SEES_LRV, "Ahead is the least recently visited station, which accepts cargo."),
        (shuttle.SEES_MRV, "Ahead is the station that was visited last."),
        (shuttle.DOCKED_AT_MRV, "It is docked at the station that was visited last."),
        (shuttle.NOTHING, "It sees nothing but stars. Time is up."),
        (shuttle.DOCKED_AT_LRV, "has delivered its cargo."),
    ],
)
def test_a_hidden_shuttle_tells_what_it_sees(symbol: int, message: str) -> None:
    text = told(ShuttleDocking, 4, shuttle.GO_FORWARD, 5, symbol=symbol, reveal="nothing", step=1000)
    assert message in text
    assert "LRV [? ? ? ? ?] MRV" in text


NORTH, EAST, SOUTH, WEST = range(4)


@pytest.mark.parametrize(
    ("kind", "before", "action", "now", "changes", "message"),
    [
        (CheeseMaze, None, None, 8, {}, "The start. Where it is, the agent must find out."),
        (CheeseMaze, 8, NORTH, 5, {}, "It went north."),
        (CheeseMaze, 8, EAST, 8, {"last_reward": -1.0}, "It wanted to go east, but there is a wall: -1."),
        (CheeseMaze, 6, SOUTH, 9, {"last_reward": 1.0}, "It has reached the cheese: +1."),
        (CheeseMaze, 8, NORTH, 5, {"step": 500}, "Time is up."),
        (CheeseMaze, 8, NORTH, 5, {"reveal": "nothing"}, "It wanted to go north. Now it sees walls east, west."),
        (Maze4x3, 6, NORTH, 7, {"last_reward": -0.04}, "It wanted to go north but slipped east: -0.04."),
        (Maze4x3, 6, EAST, 6, {}, "It wanted to go east, but it stayed where it was."),
        (Maze4x3, 4, EAST, 10, {"last_reward": -1.0}, "It went east into -1: -1."),
        (Maze4x3, 4, EAST, 10, {"last_reward": -1.0, "minus_ends": True}, "It came to -1, and that is the end."),
        (Maze4x3, 4, EAST, 10, {"last_reward": -0.5, "minus_reward": -0.5}, "It went east into -0.5: -0.5."),
        (Maze4x3, 4, EAST, 10, {"last_reward": -0.04, "minus_reward": -0.04}, "It went east into -: -0.04."),
        (Maze4x3, 2, EAST, 9, {"last_reward": 1.0}, "It has reached the end: +1."),
        (Maze89, 5, maze89.FORWARD, 9, {}, "It went ahead."),
        (Maze89, 10, maze89.FORWARD, 13, {}, "It wanted to go ahead but came out on the left."),
        (Maze89, 10, maze89.FORWARD, 7, {}, "It wanted to go ahead but came out on the right."),
        (Maze89, 9, maze89.FORWARD, 5, {}, "It wanted to go ahead but slid backwards."),
        (Maze89, 9, maze89.FORWARD, 7, {}, "It wanted to go ahead but slid backwards and turned about."),
        (Maze89, 9, maze89.FORWARD, 9, {}, "It wanted to go ahead, but it stayed where it was."),
        (Maze89, 8, maze89.FORWARD, 8, {}, "It wanted to go ahead, but there is a wall."),
        (Maze89, 8, maze89.TURN_LEFT, 11, {}, "It turned left."),
        (Maze89, 8, maze89.TURN_LEFT, 10, {}, "It wanted to turn left but turned about."),
        (Maze89, 8, maze89.TURN_LEFT, 8, {}, "It wanted to turn left but did not turn."),
        (Maze89, 8, maze89.TURN_ABOUT, 10, {}, "It turned about."),
        (Maze89, 8, maze89.DO_NOTHING, 8, {}, "It did nothing."),
        (Maze89, 65, maze89.FORWARD, 88, {"last_reward": 1.0}, "It has reached the goal: +1."),
        (Maze89, 9, maze89.FORWARD, 5, {"reveal": "nothing"}, "It wanted to go ahead. Now it sees walls"),
    ],
)
def test_mazes_tell_what_happened(
    kind: type[TabularEnv], before: int | None, action: int | None, now: int, changes: dict[str, Any], message: str
) -> None:
    assert message in told(kind, before, action, now, **changes)


def test_maps_show_the_agent_where_it_is() -> None:
    assert told(CheeseMaze, 8, NORTH, 5).splitlines()[1] == " A#.#."
    assert told(CheeseMaze, 8, NORTH, 5, reveal="nothing").splitlines()[1] == " .#.#."
    assert told(Maze4x3, 1, EAST, 2).splitlines()[0].startswith(" ..A+  ")
    assert [told(Maze89, None, None, 4 * 5 + heading).splitlines()[1][1] for heading in range(4)] == list("^>v<")
    assert told(Maze89, 65, maze89.FORWARD, 88).splitlines()[3] == " ..#.#.>"


def test_errors_of_the_eyes_are_pointed_out_to_those_who_may_know() -> None:
    """Cell 5 facing east: walls on the right, behind and on the left."""
    for bits, errors in (
        ((0, 1, 1, 1), ""),
        ((1, 1, 0, 1), "ahead, behind"),
        ((0, 0, 1, 0), "on the right, on the left"),
    ):
        symbol = maze89.BITS.tolist().index(list(bits))
        text = told(Maze89, 20, maze89.TURN_RIGHT, 21, symbol=symbol)
        assert ("wrong about" in text) == bool(errors)
        assert f" wrong about the wall {errors}" in text or not errors
        assert "wrong about" not in told(Maze89, 20, maze89.TURN_RIGHT, 21, symbol=symbol, reveal="nothing")


@pytest.mark.parametrize(("kind", "grid"), [(CheeseMaze, cheese_maze.GRID), (Maze4x3, maze4x3.GRID)])
def test_exact_eyes_make_no_errors(kind: type[TabularEnv], grid: Grid) -> None:
    for cell in range(len(grid.cells)):
        assert "wrong about" not in told(kind, int(grid.neighbours[cell, NORTH]), SOUTH, cell)
