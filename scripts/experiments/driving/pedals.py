"""Pedals too: section 3.4.4 without the controller that holds the speed, by black-box search on the embedded track."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from contextlib import closing
from functools import cache
from itertools import product
from typing import Any, Final

import gymnasium as gym
import numpy as np
from typing_extensions import override

from dpsearch.envs.driving.track import Track
from dpsearch.envs.torcs import best_lap
from dpsearch.envs.torcs.env import TORCS
from dpsearch.policies import PolicyRunner, RecurrentPolicy
from dpsearch.report.statistics import Statistic
from dpsearch.report.tables import SUCCESS_RATE, Row
from scripts.experiments.driving.log import LAP, NO_LAP, WALL, Drive, Logbook
from scripts.experiments.experiment import Cell, Method
from scripts.experiments.jobs import Outcome
from scripts.experiments.learning import ENV_STEPS, learn
from scripts.experiments.training import compose

ROAD: Final = "g-track-2"
WIDTH: Final = 15.0  # of that road in TORCS (m)
SIMULATORS: Final = {"track": f"embedded {ROAD}", "torcs": f"TORCS, {ROAD}, unchanged"}
TEST_STEPS: Final = 9000  # five minutes: at least three laps of a car that is fast enough
ENOUGH: Final = 1.3  # times the lap of TORCS' own driver

RATIO, NEAR, OFF_SHARE, HOURS = "ratio", "near", "off_share", "hours"
PEDAL_WORDS: Final = {
    SUCCESS_RATE: "runs with a clean lap",
    RATIO: "times that of TORCS' own driver",
    NEAR: f"at most {ENOUGH:g} times, % of runs",
    OFF_SHARE: "off the road, % of the time",
    HOURS: "hours of driving searched",
}
PEDALS: Final = Method("pedals", "black-box search, pedals too", ("experiment=driving_pedals",))
BETTER: Final = Method("pedals_better", "the better of two such searches, by its lap on the embedded track")


class PedalsCell(Cell):
    """Runs that search once and drive twice, so they have a line of the table for each simulator.

    Two runs, the first and the second and so on, are also two searches of which the better one is kept.
    """

    @override
    def rows(self, outcomes: Sequence[Outcome], metrics: Sequence[str], statistic: Statistic) -> list[Row]:
        """Lines of the table for each simulator: the drives of all runs, and those of the better of two."""
        better = [better_of(pair) for pair in zip(outcomes[::2], outcomes[1::2], strict=False)]
        rows = []
        for (name, task), (method, runs) in product(
            SIMULATORS.items(), [(self.method, outcomes), *([(BETTER, better)] if better else [])]
        ):
            cell = Cell(task, method, self.recipe, self.settings)
            told = [{**run[name], "solved": int(run[name][LAP] < NO_LAP)} for run in runs]
            rows += cell.rows(told, (LAP, RATIO), statistic)  # a lap that there is not would drown all others
            everyone = [{**one, "solved": 1} for one in told]
            rows += cell.rows(everyone, (NEAR, OFF_SHARE, HOURS, WALL), statistic)[1:]
        return rows


def better_of(runs: Sequence[Outcome]) -> Outcome:
    """The run with the best lap on the embedded track, with the hours and the time of all of them."""
    best = min(runs, key=lambda run: float(run["track"][LAP]))
    spent = {what: sum(run["track"][what] for run in runs) for what in (HOURS, WALL)}
    return {**best, **{name: {**best[name], **spent} for name in SIMULATORS}}


def pedals_cell() -> Cell:
    """The search that ``experiment=driving_pedals`` makes."""
    return PedalsCell(ROAD, PEDALS, PEDALS.overrides, compose(PEDALS.overrides), work=search_and_drive)


def search_and_drive(overrides: tuple[str, ...], seed: int) -> Outcome:
    """Search on the embedded track, then drive there and in TORCS with the policy that was found."""
    settings = compose(overrides)
    run = learn(settings, seed)
    run.algorithm.close()
    searched = {HOURS: run.algorithm.env_steps / 108_000, WALL: run.wall_seconds}
    kwargs = settings.config.env.recipe().kwargs
    rules = {name: kwargs[name] for name in ("speed_profile", "observations", "lookahead", "control_hz")}
    cars = {"track": Track(track=ROAD, width=WIDTH, **rules), "torcs": TORCS(track=ROAD, **rules)}
    told = {name: {**as_driven(drive_on(run.algorithm.policy, car)), **searched} for name, car in cars.items()}
    return {"solved": 1, **run.counts(ENV_STEPS), **told}


def drive_on(policy: RecurrentPolicy, env: gym.Env[Any, Any], steps: int = TEST_STEPS) -> Drive:
    """Drive so many steps; a car that is stuck is put back on the road, slow and without memory."""
    rows = array("d")
    runner = PolicyRunner(policy, greedy=True)
    with closing(Logbook(env, rows)) as book:
        observation, _ = book.reset(seed=0)
        for _ in range(steps):
            observation, _, terminated, truncated, info = book.step(runner.act(observation[None])[0])
            if terminated or truncated:
                observation, _ = book.reset(options=info["carry_on"])
                runner.reset()
    return Drive(rows)


def as_driven(drive: Drive) -> dict[str, float]:
    """The metrics of a drive, its lap beside that of TORCS' own driver."""
    ratio = drive.best_lap / own_driver()
    return {
        LAP: drive.best_lap,
        RATIO: ratio,
        NEAR: 100.0 * (ratio <= ENOUGH),
        OFF_SHARE: 100.0 * float(np.mean(drive.off_road)),
    }


@cache
def own_driver() -> float:
    """The best lap of TORCS' own driver (s)."""
    return best_lap(ROAD)
