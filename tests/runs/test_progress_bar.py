import io
import sys
from time import perf_counter

import pytest

from dpsearch.algos import RPG
from dpsearch.envs import TMaze
from dpsearch.kernels import machine_code
from dpsearch.runs import Limits
from dpsearch.runs.progress_bar import LINE_SECONDS, Progress


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.fixture
def rpg() -> RPG:
    return RPG(TMaze(corridor_length=2), batch_size=2)


def test_a_terminal_shows_a_bar(rpg: RPG, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    progress = Progress(rpg, Limits(total_steps=10**6))
    rpg.update()
    progress.update(perf_counter())
    progress.close()
    shown = terminal.getvalue()
    assert "1.00M" in shown
    assert "steps/s" in shown
    assert "return" in shown


def test_a_terminal_is_told_once_that_kernels_are_compiled(rpg: RPG, monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    progress = Progress(rpg, Limits(total_steps=10**6))
    for kernel in ("play", "draw"):
        for listener in machine_code.listeners:
            listener(kernel)
    progress.close()
    assert terminal.getvalue().count("compiling for this processor, once") == 1
    assert not machine_code.listeners


def test_without_a_terminal_there_is_a_line_now_and_then(rpg: RPG, capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress(rpg, Limits(total_updates=4))
    rpg.update()
    progress.update(perf_counter())
    assert capsys.readouterr().err == ""
    progress.update(perf_counter() + LINE_SECONDS)
    progress.update(perf_counter() + LINE_SECONDS)
    progress.close()
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"update 1, {rpg.env_steps:,} steps, ")
    assert "return" in line
    assert line.endswith("at most 00:30 left")


def test_progress_can_be_silenced(rpg: RPG, capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress(rpg, Limits(total_updates=4), show=False)
    rpg.update()
    progress.update(perf_counter() + LINE_SECONDS)
    progress.close()
    assert capsys.readouterr().err == ""


def test_the_nearest_limit_says_how_much_is_done(rpg: RPG) -> None:
    rpg.updates, rpg.episodes, rpg.env_steps = 5, 10, 100
    assert Limits(total_updates=10, total_episodes=100, total_steps=1000).fraction(rpg) == 0.5
    assert Limits(until_solved=True).fraction(rpg) == 0.0
