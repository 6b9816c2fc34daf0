"""Driving: section 3.4.4, in TORCS and on the embedded track."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from array import array
from contextlib import suppress
from functools import partial
from time import perf_counter
from typing import Any

from dpsearch.algos import Algorithm
from dpsearch.envs.torcs import Installation, TorcsError
from dpsearch.envs.torcs.reference import best_lap
from dpsearch.report.tables import Row, Section
from dpsearch.rollout import make_rollouts
from scripts.arguments import named
from scripts.experiments.driving_figures import draw_drives
from scripts.experiments.driving_log import NO_LAP, Drive, Logbook
from scripts.experiments.experiment import Cell, Experiment, Method
from scripts.experiments.jobs import Outcome
from scripts.experiments.training import compose

TASKS = {"torcs": "TORCS, e-track-1", "track": "embedded track 1"}
TWO_MINUTES = 120.0  # of driving (s)

SETTLED, WITHIN, FOR_GOOD, OFF, CLEAN, LAP, WALL = "settled", "within", "for_good", "off", "clean", "lap", "wall"
WORDS = {
    SETTLED: "first 5 clean minutes begin after, s",
    WITHIN: "and never left it after 2 minutes, % of runs",
    FOR_GOOD: "off it for the last time after, s",
    OFF: "off the road after 2 minutes, s a minute",
    CLEAN: "fastest clean minute, km/h",
    LAP: "best clean lap, s",
    WALL: "wall time, s",
}
CURVE = "off_seconds"

OURS = Method("rpg", "RPG, our settings", ("algo=rpg",))
THESIS = Method("rpg_thesis", "RPG, the thesis's settings", ("experiment=driving_thesis",))
FASTER = Method(
    "rpg_faster",
    "RPG, our settings, up to 130 km/h in an hour",
    ("algo=rpg", "env.speed_profile=[10,130,3600]", "total_steps=108_000"),
)
METHODS = {method.name: method for method in (OURS, THESIS, FASTER)}
# Section 3.4.4: 10 of 10 runs, "just under 2 minutes", 70 km/h, "just under 3 minutes"
REPORTED = {SETTLED: 120.0, CLEAN: 70.0, LAP: 180.0}


def learner(overrides: tuple[str, ...], seed: int) -> tuple[Algorithm[Any], array[float]]:
    """What ``train.py`` would make with these overrides, and the book in which its driving is noted."""
    settings = compose(overrides)
    recipe, rows = settings.config.env.recipe(), array("d")
    rollouts = make_rollouts(lambda: Logbook(recipe.make(), rows))
    return settings.algorithm(rollouts, seed), rows


def measure(overrides: tuple[str, ...], seed: int) -> Outcome:
    """Learn while driving, and say how the drive was."""
    algorithm, rows = learner(overrides, seed)
    start = perf_counter()
    with suppress(FloatingPointError):  # it diverged: the drive is what it is
        algorithm.learn(total_steps=compose(overrides).config.total_steps)
    wall = perf_counter() - start
    algorithm.close()
    drive = Drive(rows)
    later = drive.off_seconds[2:]
    return {
        "solved": 1,
        SETTLED: drive.settled,
        WITHIN: 100.0 * (max(drive.settled, drive.last_off) <= TWO_MINUTES),
        FOR_GOOD: drive.last_off,
        OFF: sum(later) / max(len(later), 1),
        CLEAN: drive.clean_speed,
        LAP: drive.best_lap,
        WALL: wall,
        CURVE: drive.off_seconds,
        "env_steps": algorithm.env_steps,
    }


def has_torcs() -> bool:
    """Whether TORCS can be driven here."""
    try:
        Installation.find()
    except TorcsError:
        return False
    return True


def _add_options(parser: ArgumentParser) -> None:
    available = [name for name in TASKS if name != "torcs" or has_torcs()]
    parser.add_argument(
        "--methods", type=named(METHODS), default=list(METHODS.values()), metavar="M,..",
        help=f"which; default: {','.join(METHODS)}",
    )  # fmt: skip
    parser.add_argument(
        "--simulators", type=named({name: name for name in TASKS}), default=available, metavar="S,..",
        help="torcs, track; default: both, or track alone where TORCS is not installed",
    )  # fmt: skip


def _cells(args: Namespace) -> list[Cell]:
    cells = []
    for simulator in args.simulators:
        for method in args.methods:
            overrides = (*method.overrides, f"env={simulator}")
            cells.append(Cell(TASKS[simulator], method, overrides, compose(overrides)))
    return cells


def _sections(args: Namespace, rows: list[Row]) -> list[Section]:
    def row(metric: str, value: float, method: str, task: str) -> Row:
        return Row(task=task, method=method, network="", metric=metric).with_report(value, value)

    theirs = [row(metric, value, "reported: thesis", "TORCS of 2007") for metric, value in REPORTED.items()]
    if "torcs" in args.simulators:
        theirs.append(row(LAP, best_lap(), "TORCS' own driver, with pedals", TASKS["torcs"]))
    return [Section("Drives", [r for r in rows if r.metric in WORDS] + theirs)]


EXPERIMENTS = (
    Experiment(
        name="section_3_4_4",
        title="Section 3.4.4: learning to steer a racing car",
        text="A run is a drive of half an hour, or of an hour up to 130 km/h, in which the car learns as it goes and "
        "acts with all its noise. *Clean* minutes and laps are those that did not leave the road, and minutes only if "
        "nine tenths of the way were got ahead along the road, not in circles. A run without a clean lap counts as "
        f"{NO_LAP:,.0f} s. Numbers are means over runs with the 95% bootstrap interval. The figure has the last lap of "
        "the first run of the first line.",
        runs=10,
        statistic="mean",
        metrics=tuple(WORDS),
        words=WORDS,
        run=measure,
        add_options=_add_options,
        cells=_cells,
        sections=_sections,
        draw=partial(draw_drives, learner),
        log="driving",
        fewer={FASTER.name: 5},
    ),
)
