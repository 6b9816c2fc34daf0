"""Numbers that others report on racing: the thesis, and TORCS' own driver."""

from __future__ import annotations

from dpsearch.envs.torcs.reference import best_lap
from dpsearch.report.tables import Row
from scripts.experiments.driving.log import CLEAN, LAP, SETTLED
from scripts.experiments.experiment import reported

# Section 3.4.4: 10 of 10 runs, "just under 2 minutes", 70 km/h, "just under 3 minutes"
THESIS = {SETTLED: 120.0, CLEAN: 70.0, LAP: 180.0}


def thesis() -> list[Row]:
    """The thesis's numbers, as rows of the table."""
    return [reported("TORCS of 2007", "reported: thesis", metric, value) for metric, value in THESIS.items()]


def own_driver(task: str) -> Row:
    """The lap of TORCS' own driver, which has to be installed."""
    return reported(task, "TORCS' own driver, with pedals", LAP, best_lap("g-track-2"))
