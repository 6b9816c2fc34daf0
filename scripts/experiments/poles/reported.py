"""Numbers that the thesis and others report on pole balancing: evaluations until success."""

from __future__ import annotations

from dpsearch.report.tables import SUCCESS_RATE, Row
from scripts.experiments.experiment import reported
from scripts.experiments.learning import EVALUATIONS

RUNS = 200  # of each cell in the thesis
# By method and task: mean, standard deviation, and how many of the runs succeeded
THESIS = {
    "rpg": {  # table 3.1
        "single_pole": (756, 227, 200),
        "single_pole_hidden": (2087, 607, 200),
        "double_pole": (5218, 1236, 200),
        "double_pole_hidden": (6139, 1425, 200),
    },
    "nes": {  # table 4.2
        "single_pole": (232, 65, 200),
        "single_pole_hidden": (538, 134, 200),
        "double_pole": (1150, 426, 200),
        "double_pole_hidden": (1443, 521, 200),
    },
    "fem": {  # table 5.1
        "single_pole": (103, 37, 200),
        "single_pole_hidden": (235, 48, 200),
        "double_pole": (1203, 632, 164),
        "double_pole_hidden": (1304, 801, 152),
    },
}
# Two poles without velocities. Table 7.4, and for CMA-ES and RPG the thesis's own chapter 3 and Gomez et al. (2008)
TWO_POLES = {"SANE": 262_700, "ESP": 7374, "RPG": 6139, "CMA-ES": 3521, "CoSyNE": 1249}
# With one recurrent unit: Wierstra et al. (2014), medians of 100 runs
ONE_UNIT = {"CoSyNE": 410, "xNES": 215, "SNES": 200, "xNES, mixing, adaptation": 170}


def thesis(method: str, env: str) -> dict[str, float]:
    """The thesis's numbers of a method, ``rpg``, ``nes`` or ``fem``, on a task."""
    mean, std, solved = THESIS[method][env]
    return {EVALUATIONS: mean, f"{EVALUATIONS}_std": std, SUCCESS_RATE: solved / RUNS}


def rows(numbers: dict[str, int], task: str) -> list[Row]:
    """Numbers of others by method, as rows of the table."""
    return [reported(task, f"reported: {name}", EVALUATIONS, value) for name, value in numbers.items()]
