"""The embedded car beside that of the real TORCS, as recorded: the same commands lead to nearly the same places."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from dpsearch.env_kit.stepper import LaneStepper
from dpsearch.envs import Track
from dpsearch.envs.driving import kernel as rows
from dpsearch.envs.driving.car import Car
from dpsearch.envs.driving.rules import KMH
from dpsearch.envs.driving.track import track_task

PLANE = [["straight", 6000], ["turn", 400, 180], ["straight", 6000], ["turn", 400, 180]]


class Run(NamedTuple):
    """A command, from when the car drove straight ahead at a speed.

    Attributes:
        surface: Asphalt or grass.
        command: "steer", while a controller holds the speed; "pedal", straight ahead; or, for example, "pedal-0.5", to
            steer with that pedal.
        value: Of the command, in [-1, 1].
        kmh: The speed.
    """

    surface: str
    command: str
    value: float
    kmh: float


def recorded() -> dict[Run, NDArray[np.float64]]:
    """What TORCS did: time, x, y, yaw and speed (s, m, rad, m/s) in rows."""
    lines = (Path(__file__).parents[2] / "support" / "torcs_recording.txt").read_text().splitlines()
    words = [line.split() for line in lines if not line.startswith("#")]
    runs = itertools.groupby(words, lambda row: Run(row[0], row[1], float(row[2]), float(row[3])))
    return {run: np.array([list(map(float, row[4:])) for row in group]) for run, group in runs}


RUNS = recorded()


def driven(run: Run, torcs: NDArray[np.float64]) -> NDArray[np.float64]:
    """What the embedded car does at the same times."""
    steers, grass = run.command == "steer", run.surface == "grass"
    env = Track(PLANE, speed_profile=run.kmh if steers else None, stuck_seconds=60.0)
    width, car = (20.0, replace(Car(), verge=300.0)) if grass else (300.0, Car())
    env.task = track_task(PLANE, width, env.task.rules, 2000, car)
    env._stepper = LaneStepper(env.task.kernel, 1)
    env.reset(seed=0, options={"distance": 100.0})
    start = env.kernel_state()
    start[rows.FORWARD] = torcs[0, 4]
    if grass:
        start[rows.OFFSET] = 100.0
    env._stepper.put(0, start)
    action = np.array([run.value] if steers else [0.0, run.value])
    if run.command not in ("steer", "pedal"):
        action = np.array([run.value, float(run.command.removeprefix("pedal"))])
    seen, steps = [], 0
    for time in torcs[:, 0]:
        for _ in range(steps, round(30 * time)):
            env.step(action)
        steps, state = round(30 * time), env.kernel_state()
        x, y = state[rows.DISTANCE] - 100.0, state[rows.OFFSET] - start[rows.OFFSET]
        seen.append([time, x, y, state[rows.ANGLE], state[rows.FORWARD]])
    return np.array(seen)


def missed(run: Run) -> tuple[float, float, float]:
    """By how much the car misses TORCS' after 2 s: share of the way, change of heading (rad), its error (rad)."""
    torcs = RUNS[run]
    ours = driven(run, torcs)
    gap = math.dist(ours[-1, 1:3], torcs[-1, 1:3])
    way = 2.0 * run.kmh / KMH
    return gap / way, float(torcs[-1, 3]), math.remainder(ours[-1, 3] - torcs[-1, 3], 2 * math.pi)


def together() -> list[Run]:
    """The runs in which the wheels were turned while a pedal was pressed."""
    return [run for run in RUNS if run.command not in ("steer", "pedal")]


def steering(surface: str, lowest: float, highest: float) -> list[Run]:
    """The runs in which the wheels were turned, of a range of the command."""
    return [run for run in RUNS if (run.surface, run.command) == (surface, "steer") and lowest <= run.value <= highest]


@pytest.mark.parametrize("run", steering("asphalt", 0.0, 0.1), ids=str)
def test_steering_leads_to_the_same_place(run: Run) -> None:
    share, turned, error = missed(run)
    assert share < 0.03
    assert abs(error) < max(0.07 * turned, math.radians(0.8))


@pytest.mark.parametrize("run", steering("asphalt", 0.2, 0.4), ids=str)
def test_the_car_slides_like_that_of_torcs(run: Run) -> None:
    share, turned, error = missed(run)
    assert share < 0.05
    assert abs(error) < 0.06 * turned


@pytest.mark.parametrize("run", steering("grass", 0.0, 1.0), ids=str)
def test_it_slides_on_grass_too(run: Run) -> None:
    share, turned, error = missed(run)
    assert share < 0.06
    assert abs(error) < 0.15 * turned


@pytest.mark.parametrize("run", [run for run in RUNS if run.command == "pedal"], ids=str)
def test_pedals_give_the_same_speeds(run: Run) -> None:
    """Within 3 km/h, or a tenth of the recording's highest speed."""
    torcs = RUNS[run]
    errors = KMH * np.abs(driven(run, torcs)[:, 4] - torcs[:, 4])
    assert errors.max() < max(3.0, 0.1 * KMH * torcs[:, 4].max())


@pytest.mark.parametrize("run", together(), ids=str)
def test_pedals_in_a_curve_lead_to_the_same_place(run: Run) -> None:
    """And to the same heading; except with full throttle at 80 km/h, where TORCS' car skids more than ours."""
    torcs = RUNS[run]
    ours = driven(run, torcs)
    skids, locked = run.command == "pedal1" and run.kmh == 80, run.command == "pedal-1"
    assert math.dist(ours[-1, 1:3], torcs[-1, 1:3]) < (7.0 if skids else 1.0 + 0.03 * torcs[-1, 1])
    turned, error = torcs[-1, 3], math.remainder(ours[-1, 3] - torcs[-1, 3], 2 * math.pi)
    if skids:
        assert -0.7 * turned < error < 0.0
    else:
        assert abs(error) < max(math.radians(5.0 if locked else 4.0), 0.2 * turned)


@pytest.mark.parametrize("kmh", [120.0, 160.0, 200.0])
def test_some_brake_makes_the_car_spin_and_all_of_it_makes_it_go_straight_on(kmh: float) -> None:
    runs = {pedal: Run("asphalt", f"pedal{pedal:g}", 0.05, kmh) for pedal in (-1.0, -0.5, 0.5)}
    theirs = {pedal: RUNS[run][-1, 3] for pedal, run in runs.items()}
    ours = {pedal: driven(run, RUNS[run])[-1, 3] for pedal, run in runs.items()}
    for turned in (theirs, ours):
        assert turned[-0.5] > 1.7 * turned[0.5]
        assert turned[-1.0] < 0.2 * turned[0.5]
