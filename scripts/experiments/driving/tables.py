"""Driving: section 3.4.4, in TORCS and on the embedded track."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from dpsearch.envs.torcs import Installation, TorcsError
from dpsearch.report.tables import SUCCESS_RATE, Row, Section
from dpsearch.runs import RunError
from scripts.arguments import add_choice
from scripts.experiments.driving import reported
from scripts.experiments.driving.figures import draw_drives
from scripts.experiments.driving.log import (
    CLEAN,
    FAILED,
    FAILS,
    FOR_GOOD,
    LAP,
    NO_LAP,
    OFF,
    SETTLED,
    UNSEEN,
    WALL,
    WITHIN,
)
from scripts.experiments.driving.pedals import BETTER, PEDAL_WORDS, PEDALS, TEST_STEPS, WIDTH, pedals_cell
from scripts.experiments.driving.runs import UNSEEN_SPEED, measure, measure_and_drive_on, measure_until_failure
from scripts.experiments.driving.search import SEARCH, SearchCell, search_steering
from scripts.experiments.experiment import Cell, Experiment, Method
from scripts.experiments.training import compose

TASKS = {"torcs": "TORCS, g-track-2", "track": "embedded g-track-2"}
WORDS = {
    SETTLED: "first 5 clean minutes begin after, s",
    WITHIN: "and never left it after 2 minutes, % of runs",
    FOR_GOOD: "off it for the last time after, s",
    OFF: "off the road after 2 minutes, s a minute",
    CLEAN: "fastest clean minute, km/h",
    LAP: "best clean lap, s",
    FAILS: "fails at, km/h",
    UNSEEN: "unseen roads driven without leaving them, %",
    **PEDAL_WORDS,
    WALL: "wall time, s",
}

OURS = Method("rpg", "RPG, our settings", ("algo=rpg",))
THESIS = Method("rpg_thesis", "RPG, the thesis's settings", ("experiment=driving_thesis",))
FASTER = Method(
    "rpg_faster",
    "RPG, our settings, learning on until it fails",
    ("algo=rpg", "env.speed_profile=[10,250,7200]", "total_steps=216_000"),
)
ONE_SIDED = Method("rpg_one_sided", "RPG, our settings, no mirror images", ("algo=rpg", "algo.mirror=false"))
FASTER_ONE_SIDED = Method(
    "rpg_faster_one_sided", f"{FASTER.label}, no mirror images", (*FASTER.overrides, "algo.mirror=false")
)
DRIVES_ON = Method(
    "rpg_drives_on", "RPG, our settings, then on without learning or noise until it fails", OURS.overrides
)
RISING = (DRIVES_ON, FASTER, FASTER_ONE_SIDED)
METHODS = {method.name: method for method in (OURS, ONE_SIDED, THESIS, *RISING, SEARCH, PEDALS)}


WORK = {
    DRIVES_ON: measure_and_drive_on,
    FASTER: measure_until_failure,
    FASTER_ONE_SIDED: measure_until_failure,
    SEARCH: search_steering,
}
"""Function that makes the runs of a method, where it is not ``measure``."""


def has_torcs() -> bool:
    """Whether TORCS can be driven here."""
    try:
        Installation.find()
    except TorcsError:
        return False
    return True


def _add_options(parser: ArgumentParser) -> None:
    available = [name for name in TASKS if name != "torcs" or has_torcs()]
    add_choice(parser, "--methods", METHODS)
    add_choice(parser, "--simulators", {name: name for name in TASKS}, available)


def _cells(args: Namespace) -> list[Cell]:
    cells = []
    for simulator in args.simulators:
        for method in args.methods:
            if method is not PEDALS:
                overrides, kind = (*method.overrides, f"env={simulator}"), SearchCell if method is SEARCH else Cell
                work = WORK.get(method)
                cells.append(kind(TASKS[simulator], method, overrides, compose(overrides), work=work))
    if not cells or isinstance(cells[0], SearchCell):
        raise RunError(
            "the figure is of RPG while it learns: --methods has to begin with one whose name begins with rpg"
        )
    if PEDALS in args.methods and set(args.simulators) == set(TASKS):
        cells.append(pedals_cell())
    return cells


def _sections(args: Namespace, rows: list[Row]) -> list[Section]:
    theirs = reported.thesis()
    if "torcs" in args.simulators:
        theirs.append(reported.own_driver(TASKS["torcs"]))
    own = [
        r for r in rows if r.metric in WORDS and (r.metric != FAILS or r.method in [method.label for method in RISING])
    ]
    steered = [row for row in own if row.method not in (PEDALS.label, BETTER.label) and row.metric != SUCCESS_RATE]
    pedals = [row for row in own if row.method in (PEDALS.label, BETTER.label)]
    sections = [Section("Drives", steered + theirs)] if steered else []
    return [*sections, Section("With throttle and brake", pedals)] if pedals else sections


EXPERIMENTS = (
    Experiment(
        name="section_3_4_4",
        title="Section 3.4.4: learning to steer a racing car",
        text="A run is a drive of half an hour up to 70 km/h in which the car learns as it goes and acts with all its "
        "noise; or that, and then the policy drives on without learning or noise while the speed goes on rising by 2 "
        "km/h a minute, up to 190: speeds and laps are of the second part, the rest of the first; or a drive on which "
        "it goes on rising as the car learns. In both the policy has failed when it spends "
        f"{FAILED:g} s of a minute or more off the road, which a car that is put back sooner does later. "
        "With our settings a step pays the speed along the road, the less of it the nearer the edge is, and a car is "
        "put back after 0.3 s off it; it learns from the mirror image of what happened too. With the thesis's settings "
        "a step pays the speed, and it takes 5 s. *Clean* minutes and laps are those "
        "that did not leave the road, and minutes only if nine tenths of the way were got ahead along it, "
        f"not in circles. A run without a clean lap counts as {NO_LAP:,.0f} s. Numbers are means over runs with the "
        "95% bootstrap interval. *Unseen* are 20 random roads of the embedded simulator, "
        f"{WIDTH:g} m wide as g-track-2 is, each driven for three minutes at {UNSEEN_SPEED:g} km/h without noise "
        "after the drive. "
        "A black-box search for the steering has about as much driving, in episodes of 20 s in which the speed runs "
        "through the same range. After each generation, a test of three minutes, which is not counted, says whether "
        "its policy leaves the road; the numbers are how much had been driven before all later tests were passed, and "
        "those of a half hour up to 70 km/h afterwards, without learning or noise. "
        "With throttle and brake there is no learning while driving: a black-box search plays episodes of a minute on "
        f"the embedded track, and what it comes up with drives {TEST_STEPS / 1800:g} minutes there and, without having "
        "learned anything of it, in TORCS. Lap times are then those of the runs that have a clean lap, all else is of "
        "all runs. "
        "Settings were chosen by results of other seeds, from 100 on. Of RPG's, the reward, when a car is put back and "
        "how soon steps shrink are of 24 seeds from 1000 on of the embedded track; some of the others are older, and "
        "chosen by seeds of the TORCS runs in the table, which is flattering. "
        "The rising drives have the first seeds of the half hours. "
        "The better of two searches is that of the first run and the second, and so on. "
        "Wall times are of several machines, most with other work beside. "
        "The figure has the last lap of the first run of the first line.",
        runs=20,
        statistic="mean",
        metrics=tuple(metric for metric in WORDS if metric not in PEDAL_WORDS),
        words=WORDS,
        run=measure,
        add_options=_add_options,
        cells=_cells,
        sections=_sections,
        draw=draw_drives,
        log="driving",
        fewer={
            OURS.name: 10,
            ONE_SIDED.name: 10,
            THESIS.name: 10,
            DRIVES_ON.name: 10,
            FASTER.name: 5,
            FASTER_ONE_SIDED.name: 5,
            SEARCH.name: 10,
        },
    ),
)
