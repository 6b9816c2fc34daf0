"""Mean evaluations to the target on the functions of table 4.1, measured with the programs of others.

The functions are rotated and shifted as here; the initial standard deviation is 0.5 rather than 1. The thesis itself
shows curves only. Where not all runs reached the target, the mean is over those that did.
"""

from __future__ import annotations

from dpsearch.report.tables import Row
from scripts.experiments.experiment import reported
from scripts.experiments.learning import EVALUATIONS

CMA = "reported: cma 4.5"
XNES = "reported: xNES, its authors' settings"
FEM = "reported: FEM's authors' implementation"
NES = "reported: NES's authors' implementation, to 1e-6"

FUNCTION_ORDER = ("Sphere", "Schwefel", "Tablet", "DiffPow", "Ellipsoid", "Cigar", "SharpR", "ParabR")
# By dimension and source, in this order; None where nothing is reported
MEANS: dict[int, dict[str, tuple[int | None, ...]]] = {
    5: {
        FEM: (3195, 3178, 5073, 2213, 5107, 5318, None, None),
        CMA: (771, 805, 1334, 688, 1497, 1711, 1234, 781),
        XNES: (1754, 1789, 2411, 914, 2530, 2778, 1294, 3343),
    },
    15: {
        NES: (6300, 9387, None, 5673, 15938, 21260, 9998, 3138),
        FEM: (12183, 12291, 16062, 7505, 15734, 20696, None, None),
        CMA: (2298, 3059, 5322, 3461, 7943, 6378, 7830, 2702),
        XNES: (17332, 17881, 20366, 7736, 23653, 27168, 9114, 7864),
    },
}
SOURCES = {"nes": NES, "fem": FEM, "cmaes": CMA, "xnes": XNES}


def by_others(task: str, function: str, dimension: int, methods: list[str]) -> list[Row]:
    """The numbers of others' programs for these methods, as rows of the table.

    Args:
        task: Name of the task in tables.
        function: Name of the function.
        dimension: Dimension d.
        methods: Names of the methods.
    """
    rows = []
    for source in (SOURCES[method] for method in methods if method in SOURCES):
        values = MEANS.get(dimension, {}).get(source)
        if values is not None and (value := values[FUNCTION_ORDER.index(function)]) is not None:
            rows.append(reported(task, source, EVALUATIONS, value))
    return rows
