"""When a start is given up."""

from __future__ import annotations

import numpy as np

from dpsearch.algos.rpg.restarts import WINDOW, Progress


def stalls_after(progress: Progress, means: list[float], batch: int = 50) -> int | None:
    """After how many batches, one for each mean."""
    for index, mean in enumerate(means):
        progress.note(np.full(batch, mean))
        if progress.stalled:
            return index + 1
    return None


def test_a_start_that_gets_no_further_is_given_up_after_its_patience() -> None:
    assert stalls_after(Progress(300, gain=0.1), [-1.0] * 20) == 2 + 6  # the window fills, then 300 episodes


def test_a_start_that_creeps_is_given_up_and_one_that_climbs_is_not() -> None:
    climbing = np.arange(30)
    assert stalls_after(Progress(300, gain=0.1), list(0.01 * climbing - 1.0)) is not None
    assert stalls_after(Progress(300, gain=0.1), list(0.03 * climbing - 1.0)) is None


def test_steps_too_small_to_count_add_up() -> None:
    assert stalls_after(Progress(300, gain=0.1), list(0.021 * np.arange(40) - 1.0)) is None  # a tenth in five batches


def test_a_short_patience_shortens_the_window() -> None:
    assert stalls_after(Progress(20, gain=0.0), [0.0] * 5, batch=10) == 2 + 2
    assert WINDOW > 20


def test_what_counts_does_not_depend_on_the_unit_of_reward() -> None:
    means = np.exp(-0.2 * np.arange(30)) + 1.0
    ends = [stalls_after(Progress(100, gain=0.02), list(unit * -means)) for unit in (1.0, 1000.0)]
    assert ends[0] == ends[1]
    assert ends[0] is not None


def test_without_patience_nothing_is_given_up() -> None:
    assert stalls_after(Progress(None, gain=0.1), [0.0] * 100) is None


def test_it_goes_on_from_a_saved_state() -> None:
    whole, first = Progress(200, gain=0.1), Progress(200, gain=0.1)
    means = [-1.0, -1.0, -0.8, -0.8, -0.8, -0.8, -0.8, -0.8]
    first_half = stalls_after(first, means[:4])
    second = Progress(200, gain=0.1)
    second.load_state_dict(first.state_dict())
    assert first_half is None
    assert stalls_after(whole, means) == 4 + (stalls_after(second, means[4:]) or 0)
