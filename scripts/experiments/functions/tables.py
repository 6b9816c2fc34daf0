"""Black-box search on the functions of table 4.1: figures 4.5, 5.1, 7.1, 7.2 (unimodal), 4.6, 5.2, 7.3 (multimodal).

Figures that show the same runs share a log of them, so each run is made once.
"""

from __future__ import annotations

from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any, cast

import numpy as np

from dpsearch.report.cross_tables import Grid
from dpsearch.report.tables import SUCCESS_RATE, Row, Section
from dpsearch.search.base import Vector
from dpsearch.search.functions import FUNCTIONS
from scripts.arguments import add_choice, at_least_one
from scripts.experiments.experiment import Cell, Experiment, Results
from scripts.experiments.functions import methods
from scripts.experiments.functions.figures import draw_comparison, draw_methods, draw_success, draw_unimodal
from scripts.experiments.functions.landscapes import FIG_4_4, TABLE_4_1
from scripts.experiments.functions.methods import METHODS, Searcher
from scripts.experiments.functions.reported import FUNCTION_ORDER, by_others
from scripts.experiments.functions.runs import Problem, minimise, summary
from scripts.experiments.learning import EVALUATIONS

UNIMODAL = FUNCTION_ORDER
MULTIMODAL = tuple(name for name, function in FUNCTIONS.items() if not function.unimodal)
DISTANCES = (0.1, 1.0, 10.0, 100.0, 1000.0)
MAX_MULTIMODAL = 20_000
TOLX, TOLX_MULTIMODAL = 1e-10, 1e-5
FACTOR = "factor"
WORDS = {SUCCESS_RATE: "solved", EVALUATIONS: "evaluations", FACTOR: "factor"}


def distances(text: str) -> list[float]:
    """Distances, separated by commas, as a type for argparse."""
    try:
        found = sorted({float(part) for part in text.split(",")})
    except ValueError:
        found = [0.0]
    if not 0.0 < found[0] <= found[-1] < np.inf:
        raise ArgumentTypeError(f"expected positive numbers, got {text!r}")
    return found


def add_options(
    parser: ArgumentParser,
    *,
    functions: Sequence[str],
    known: Sequence[str],
    searchers: Sequence[Searcher],
    sizes: Sequence[int],
    starts: Sequence[float] = (),
) -> None:
    """Add the functions' own options.

    Args:
        parser: The parser that gets them.
        functions: Default functions.
        known: Functions that may be chosen.
        searchers: Default methods.
        sizes: Default dimensions.
        starts: Default distances; empty if they cannot be chosen.
    """

    def add(option: str, convert: Callable[[str], list[Any]], default: Sequence[float]) -> None:
        words = ",".join(f"{value:g}" for value in default)
        parser.add_argument(option, type=convert, default=list(default), metavar="X,..", help=f"default: {words}")

    add_choice(parser, "--functions", {name: name for name in known}, functions)
    add_choice(parser, "--methods", {name: name for name in METHODS}, [searcher.name for searcher in searchers])
    add("--dimensions", at_least_one, sizes)
    if starts:
        add("--distances", distances, starts)


def task(function: str, dimension: int, distance: float | None = None) -> str:
    """The name of a task in tables."""
    return f"{function}, d = {dimension}" + ("" if distance is None else f", distance {distance:g}")


def unimodal_cells(args: Namespace) -> list[Cell]:
    """One cell for each dimension, function and method."""
    return [
        _cell(function, dimension, METHODS[name], None)
        for dimension in args.dimensions
        for function in args.functions
        for name in args.methods
    ]


def multimodal_cells(args: Namespace) -> list[Cell]:
    """One cell for each distance at the least dimension, and for each dimension at distance 1, and each method."""
    places = [(args.dimensions[0], distance) for distance in args.distances]
    places += [place for dimension in args.dimensions if (place := (dimension, 1.0)) not in places]
    return [
        _cell(function, dimension, METHODS[name], distance)
        for name in args.methods
        for function in args.functions
        for dimension, distance in places
    ]


def _cell(function: str, dimension: int, method: Searcher, distance: float | None) -> Cell:
    unimodal = distance is None
    problem = Problem(
        function=function,
        dimension=dimension,
        search=method.search,
        options=tuple(sorted(method.options(dimension).items())),
        distance=distance,
        max_evaluations=method.max_evaluations if unimodal else MAX_MULTIMODAL,
        tolx=TOLX if unimodal else TOLX_MULTIMODAL,
        curve=unimodal,
    )
    return Cell(task(function, dimension, distance), method, problem, problem)


def by_dimension(args: Namespace, rows: list[Row]) -> list[Section]:
    """A section for each dimension, with others' numbers, and what importance mixing saves if that was measured."""
    sections = []
    for dimension in args.dimensions:
        own = []
        for function in args.functions:
            name = task(function, dimension)
            measured = [row for row in rows if row.task == name]
            own += measured + by_others(name, function, dimension, args.methods) + _factor(name, measured)
        sections.append(Section(f"d = {dimension}", own))
    return sections


def _factor(name: str, rows: list[Row]) -> list[Row]:
    """The factor by which importance mixing saves NES evaluations; nothing if no run reaches the target."""
    found = {row.method: row for row in rows if row.metric == EVALUATIONS}
    mixing, fresh = (found.get(method.label) for method in (methods.NES, methods.NES_FRESH))
    if mixing is None or fresh is None or mixing.mean is None or fresh.mean is None:
        return []
    return [
        Row(
            task=name,
            method="NES: without / with importance mixing",
            network="",
            metric=FACTOR,
            runs=fresh.runs,
            solved=fresh.runs,
            mean=fresh.mean / mixing.mean,
        )
    ]


def by_method(args: Namespace, rows: list[Row]) -> list[Section]:
    """A section for each method."""
    labels = [METHODS[name].label for name in args.methods]
    return [Section(label, [row for row in rows if row.method == label]) for label in labels]


def curves(results: Results) -> dict[str, Any]:
    """The curves, as the JSON has them."""
    found = []
    for cell, outcomes in zip(results.cells, results.outcomes, strict=True):
        curve = summary(cast(Problem, cell.settings), outcomes)
        costs = {name: _rounded(getattr(curve, name)) for name in ("median", "low", "high")}
        place = {"task": cell.task, "method": cell.method.label, "reached": curve.reached}
        found.append({**place, "evaluations": curve.evaluations.astype(int).tolist(), **costs})
    return {"curves": found}


def _rounded(values: Vector) -> list[float]:
    return [float(f"{value:.3g}") for value in values]


UNTIL = (
    "Costs are minimised until 1e-10 is reached, or -1000 on the unbounded ridges SharpR and ParabR. The functions are "
    "rotated and shifted at random; a search starts at x ~ N(0, I) around the optimum with Sigma = I. Seed k is the "
    "same problem for all methods. A run has failed after 50,000 evaluations (NES without importance mixing: 100,000), "
    f"when the search distribution has shrunk to {TOLX:g} of its first width, or, for CMA-ES, when the package's own "
    "criteria stop it; nothing is started again. "
)
NUMBERS = (
    "The tables hold the number of the evaluation that reached the target: mean ± standard deviation, with the 95% "
    "bootstrap interval of the mean, over the runs that got there; in brackets how many these are, unless all did. "
    "Medians and success rates with their intervals are in the JSON. Numbers in italics are what others' programs need "
    "on average, with an initial standard deviation of 0.5. The thesis shows curves, not numbers. "
)
CURVES = (
    "The curves are the best cost so far: the median over the runs, and a band from the best to the worst quarter; a "
    "dot marks where the median run reaches the target. "
)
SETTINGS = (
    "NES: population 15 d, learning rate 1, refresh rate 0.01. FEM: online, with forget factor 0.1, window 50 and top "
    "5 at d = 5, and 0.02, 25 and 10 at d = 15. CMA-ES: the cma package with its defaults. "
)
ON_SUCCESS = (
    "The proportion of runs that reach a cost of 0.01, with Wilson's 95% interval; the JSON has the evaluations that "
    "this takes too. The start is at the given distance from the optimum, in a uniformly random direction, and "
    "Sigma = I whatever the distance. The functions are rotated and shifted at random, and seed k is the same problem "
    f"for all methods. A run has failed after {MAX_MULTIMODAL:,} evaluations, when the search distribution has shrunk "
    f"to {TOLX_MULTIMODAL:g} of its first width, or, for CMA-ES, when the package's own criteria stop it; nothing is "
    "started again. The settings are those of the unimodal functions, FEM's those of d = 5. Weierstrass has period 1 "
    "in each coordinate, so that there is an optimum near every start. "
)


def _unimodal(
    name: str, title: str, remark: str, functions: Sequence[str], searchers: Sequence[Searcher], sizes: Sequence[int],
    draw: Callable[[Namespace, Results, Path], None], **options: Any,
) -> Experiment:  # fmt: skip
    return Experiment(
        name=name,
        title=title,
        text=f"{remark}\n\n{UNTIL}{CURVES if draw is not draw_methods else ''}{SETTINGS}\n\n{NUMBERS}".strip(),
        runs=200,
        statistic="mean",
        metrics=(EVALUATIONS,),
        words=WORDS,
        run=minimise,
        add_options=partial(add_options, functions=functions, known=UNIMODAL, searchers=searchers, sizes=sizes),
        cells=unimodal_cells,
        sections=by_dimension,
        draw=draw,
        table=partial(Grid, line=attrgetter("method"), column=_function, corner="method"),
        extra=None if draw is draw_methods else curves,
        log="functions_unimodal",
        batch=10,
        **options,
    )


def _multimodal(name: str, title: str, remark: str, searchers: Sequence[Searcher]) -> Experiment:
    return Experiment(
        name=name,
        title=title,
        text=f"{remark}\n\n{ON_SUCCESS}".strip(),
        runs=200,
        statistic="mean",
        metrics=(EVALUATIONS,),
        words={SUCCESS_RATE: "solved"},
        run=minimise,
        add_options=partial(
            add_options, functions=MULTIMODAL, known=MULTIMODAL, searchers=searchers, sizes=(2, 3, 4, 5),
            starts=DISTANCES,
        ),
        cells=multimodal_cells,
        sections=by_method,
        draw=draw_success,
        table=partial(Grid, line=_function, column=_place, corner="function"),
        log="functions_multimodal",
        batch=50,
    )  # fmt: skip


def _function(row: Row) -> str:
    return row.task.partition(", ")[0]


def _place(row: Row) -> str:
    return row.task.partition(", ")[2]


CORE = (methods.NES, methods.FEM, methods.CMAES)
EXTRA_RUNS = 50  # of methods beyond the thesis

EXPERIMENTS = (
    TABLE_4_1,
    FIG_4_4,
    _unimodal(
        "fig_4_5",
        "Figure 4.5: NES on the unimodal functions",
        "The thesis: 200 runs of each function, at d = 5 (left) and d = 15 (right).",
        UNIMODAL, (methods.NES,), (5, 15), draw_unimodal,
    ),
    _multimodal(
        "fig_4_6",
        "Figure 4.6: NES on the multimodal functions",
        "The thesis: 200 runs each; at distance 1, the curves of Ackley and Griewank overlay each other.",
        (methods.NES,),
    ),
    _unimodal(
        "fig_5_1",
        "Figure 5.1: FEM on the unimodal functions",
        "The thesis: all of 200 runs of each function converged to the optimum.",
        UNIMODAL, (methods.FEM,), (5, 15), draw_unimodal,
    ),
    _multimodal(
        "fig_5_2",
        "Figure 5.2: FEM on the multimodal functions",
        "The thesis: FEM fares especially badly on Weierstrass and Rastrigin; at distance 1, the curves of Ackley and "
        "Griewank overlay each other. It varies the distance between 1 and 100.",
        (methods.FEM,),
    ),
    _unimodal(
        "fig_7_1",
        "Figure 7.1: NES, FEM and CMA-ES on Sphere, Schwefel, Cigar and Tablet",
        "The thesis: CMA-ES converges faster than FEM and NES on Sphere; on Tablet, NES clearly outperforms both.",
        ("Sphere", "Schwefel", "Cigar", "Tablet"), CORE, (15,), draw_comparison,
    ),
    _unimodal(
        "fig_7_2",
        "Figure 7.2: NES, FEM and CMA-ES on DiffPow, Ellipsoid, SharpR and ParabR",
        "The thesis: on DiffPow and Ellipsoid, NES clearly outperforms CMA-ES and FEM.",
        ("DiffPow", "Ellipsoid", "SharpR", "ParabR"), CORE, (15,), draw_comparison,
    ),
    _multimodal(
        "fig_7_3",
        "Figure 7.3: NES, FEM and CMA-ES on the multimodal functions",
        "The thesis: NES and CMA-ES behave much alike, while FEM quickly deteriorates with the dimension.",
        CORE,
    ),
    _unimodal(
        "functions",
        "The unimodal functions, and ways to need fewer evaluations",
        "All searches of this package, with what goes beyond the thesis. NES with the exact natural gradient needs no "
        "regression, so a smaller population does. Importance mixing, which the thesis has for NES, serves xNES as "
        "well. FEM with a covariance that forgets more slowly than the mean is this package's default. The thesis "
        "says of importance mixing that it reduces the evaluations by at least a factor of 3 (section 4.5).",
        UNIMODAL, tuple(METHODS.values()), (5, 15), draw_methods,
        fewer={name: EXTRA_RUNS for name, method in METHODS.items() if method not in CORE},
    ),
)  # fmt: skip
