"""Table 4.1, the functions themselves, and figure 4.4, the course of one search on one of them."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import Any

import numpy as np

from dpsearch.files import versions
from dpsearch.report.document import Document
from dpsearch.report.provenance import machine
from dpsearch.report.tables import number
from dpsearch.search import NES
from dpsearch.search.base import Matrix, Vector
from dpsearch.search.functions import FUNCTIONS, Function
from scripts.arguments import at_least
from scripts.experiments.experiment import Illustration, no_options
from scripts.experiments.functions.figures import draw_search

RASTRIGIN = FUNCTIONS["Rastrigin"]
STDS = 0.5  # standard deviations that the ellipses of figure 4.4 show
START = (-3.0, 2.0)


def table_4_1(args: Namespace, how: str) -> Document:
    """The twelve functions, with their costs at a few points."""
    points = _points(args.dimension)
    rows = [_described(function, points) for function in FUNCTIONS.values()]
    head = ["name", "type", "cost", "least", *(f"at {words}" for words in points), "target"]
    lines = [head, ["---"] * 3 + ["---:"] * (len(head) - 3)]
    for row in rows:
        costs = [number(value) if abs(value) >= 1e-12 else "0" for value in row["costs"].values()]
        least = "none" if row["least"] is None else "0"
        cost = row["cost"].replace("|", r"\|")
        lines.append([row["name"], row["type"], f"`{cost}`", least, *costs, f"{row['target']:g}"])
    text = (
        f"Costs of z = (z_1, .., z_d), to be minimised, here at d = {args.dimension}: at the origin, where the optimum "
        "is unless the function is unbounded, at the first and last unit vector, and where all coordinates are 0.5. "
        "Before a search, the functions are rotated (uniformly at random) and shifted. Weierstrass has its value at "
        "the origin subtracted; it has period 1 in each coordinate, so that there is an optimum near every point."
    )
    page = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    content = {"dimension": args.dimension, "points": {k: list(v) for k, v in points.items()}, "rows": rows}
    return Document(
        name="table_4_1", title=TABLE_4_1.title, text=f"{text}\n\n{page}", content=content,
        command=how, versions=versions(), machine=machine(),
    )  # fmt: skip


def _points(dimension: int) -> dict[str, tuple[float, ...]]:
    unit = np.eye(dimension)
    named = {"0": np.zeros(dimension), "e_1": unit[0], "e_d": unit[-1], "(0.5, .., 0.5)": np.full(dimension, 0.5)}
    return {words: tuple(point.tolist()) for words, point in named.items()}


def _described(function: Function, points: dict[str, tuple[float, ...]]) -> dict[str, Any]:
    formula = (function.cost.__doc__ or "").strip().split(", Schwefel")[0].partition(": unbounded")[0].rstrip(".")
    costs = function(np.array(list(points.values())))
    return {
        "name": function.name,
        "type": "unimodal" if function.unimodal else "multimodal",
        "cost": formula[0].lower() + formula[1:],
        "least": None if function.target < 0.0 else 0.0,
        "target": function.target,
        "costs": dict(zip(points, costs.tolist(), strict=True)),
    }


def fig_4_4(args: Namespace, how: str) -> Document:
    """One search by NES on the two-dimensional Rastrigin function, generation by generation."""
    search = NES(START, 1.0, seed=args.seed, target=-RASTRIGIN.target, max_evaluations=10_000, tolx=1e-8)
    course: list[tuple[Vector, Matrix, int]] = [(search.mean, search.factor, 0)]
    told: list[Matrix] = []
    while not search.stop():
        points = search.ask()
        search.tell(points, -RASTRIGIN(points))
        told.append(points)
        course.append((search.mean, search.factor, search.evaluations))
    draw_search(RASTRIGIN, course, STDS, args.out / "fig_4_4.png")
    end = f"{'reached' if 'target' in search.stop() else 'stopped without'} a cost of {RASTRIGIN.target}"
    ellipses = [
        {"generation": k, "evaluations": evaluations, "mean": _short(mean), "covariance": _short(factor @ factor.T)}
        for k, (mean, factor, evaluations) in enumerate(course)
    ]
    text = (
        "The search distributions of one run, from the first (light) to the last (dark), on the Rastrigin function in "
        f"two dimensions: ellipses of {STDS} standard deviations. The optimum is at (0, 0). The search starts at "
        f"{START} with Sigma = I, population {search.population} and importance mixing. It {end} after "
        f"{search.generations} generations and {search.evaluations} evaluations; the line joins the means of all of "
        "them. The default seed was chosen for a run that finds the optimum: 18 of the first 200 from here do, the "
        "others end in a local one."
    )
    return Document(
        name="fig_4_4", title=FIG_4_4.title, text=text, figure=True,
        content={"seed": args.seed, "stds": STDS, "best": -search.best.fitness, "ellipses": ellipses},
        command=how, versions=versions(), machine=machine(),
    )  # fmt: skip


def _short(values: Matrix) -> Any:
    return np.vectorize(lambda value: float(f"{value:.4g}"))(values).tolist()


def _dimension(parser: ArgumentParser) -> None:
    parser.add_argument("--dimension", type=at_least(2), default=5, help="default: %(default)s")


TABLE_4_1 = Illustration("table_4_1", "Table 4.1: twelve functions for black-box search", _dimension, table_4_1)
FIG_4_4 = Illustration(
    "fig_4_4", "Figure 4.4: the search distributions of NES on Rastrigin", no_options, fig_4_4, seed=2
)
