"""The figures of the functions of table 4.1: a colour for each method, or function where there is one method."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Ellipse
from matplotlib.ticker import FixedLocator, LogLocator, NullLocator, PercentFormatter

from dpsearch.report.figures import COLOURS, GREY, MARKERS, curve, figure, logarithmic, name_lines
from dpsearch.report.tables import SUCCESS_RATE, Row
from dpsearch.search.base import Matrix, Vector
from dpsearch.search.functions import FUNCTIONS, Function
from scripts.experiments.experiment import Cell, Results
from scripts.experiments.functions.methods import METHODS
from scripts.experiments.functions.runs import SPAN, Curve, Problem, summary

Course = Sequence[tuple[Vector, Matrix, int]]
"""Mean ``(d,)``, factor ``(d, d)`` of the covariance, and evaluations so far, of each generation of a search."""

DRAWN = 12  # of all search distributions, as many as one can tell apart
METHOD_COLOURS = dict(zip(METHODS, (*COLOURS, GREY, "#8C510A", "black"), strict=True))
METHOD_MARKERS = dict(zip(METHODS, (*MARKERS, "X", "<", "*"), strict=True))


def draw_unimodal(args: Namespace, results: Results, path: Path) -> None:
    """Cost over evaluations: a column for each dimension, the bounded functions above the ridges."""
    cells = _curves(results)
    bounded = [name for name in args.functions if FUNCTIONS[name].target > 0.0]
    ridges = [name for name in args.functions if FUNCTIONS[name].target < 0.0]
    groups = [group for group in (bounded, ridges) if group]
    heights = [3.0 if group is bounded else 2.0 for group in groups]
    columns = len(args.dimensions)
    with figure(path, heights, columns=columns, size=(1.5 + 4.5 * columns, 1.0 + 1.5 * sum(heights))) as panels:
        for row, group in zip(panels, groups, strict=True):
            for axes, dimension in zip(row, args.dimensions, strict=True):
                shown = []
                for number, name in enumerate(group):
                    for cell, found in cells:
                        if (cell.function, cell.dimension) == (name, dimension):
                            _draw_curve(axes, found, COLOURS[number], name, FUNCTIONS[name].target)
                            shown.append(found)
                _finish(axes, shown, dimension, FUNCTIONS[group[0]].target)
                axes.set_title(f"{_kind(group[0])}, d = {dimension}")
            row[-1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5))


def draw_comparison(args: Namespace, results: Results, path: Path) -> None:
    """Cost over evaluations: a panel for each function and dimension, a curve for each method."""
    cells = _curves(results)
    places = [(name, dimension) for dimension in args.dimensions for name in args.functions]
    columns = min(2, len(places))
    rows = -(-len(places) // columns)
    with figure(path, [1.0] * rows, columns=columns, size=(1.0 + 4.2 * columns, 0.6 + 3.0 * rows)) as panels:
        flat: Sequence[Axes] = panels.ravel().tolist()
        for axes, (name, dimension) in zip(flat, places, strict=False):
            shown = []
            for cell, found, method in (
                (cell, found, m) for (cell, found), m in zip(cells, results.cells, strict=True)
            ):
                if (cell.function, cell.dimension) == (name, dimension):
                    colour = METHOD_COLOURS[method.method.name]
                    _draw_curve(axes, found, colour, method.method.label, FUNCTIONS[name].target)
                    shown.append(found)
            _finish(axes, shown, dimension, FUNCTIONS[name].target)
            axes.set_title(f"{name}, d = {dimension}")
        for axes in flat[len(places) :]:
            axes.set_visible(False)
        flat[0].figure.legend(*flat[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)


def draw_methods(args: Namespace, results: Results, path: Path) -> None:
    """Evaluations until the target: a line for each function, a mark for each method."""
    found = {(row.task, row.method): row for row in results.rows if row.metric == "evaluations" and row.runs}
    rates = {(row.task, row.method): row for row in results.rows if row.metric == SUCCESS_RATE}
    columns = len(args.dimensions)
    size = (1.5 + 4.4 * columns, 1.4 + 0.62 * len(args.functions))
    with figure(path, [1.0], columns=columns, size=size) as panels:
        for axes, dimension in zip(panels[0], args.dimensions, strict=True):
            for k, name in enumerate(args.methods):
                method = METHODS[name]
                offset = 0.7 * ((k + 0.5) / len(args.methods) - 0.5)
                places = [
                    (found[task, method.label].mean, place + offset, rates[task, method.label].mean == 1.0)
                    for place, task in enumerate(f"{function}, d = {dimension}" for function in args.functions)
                ]
                for full, style in ((True, "full"), (False, "none")):
                    points = [(x, y) for x, y, all_solved in places if x is not None and all_solved == full]
                    axes.plot(
                        [x for x, _ in points], [y for _, y in points], METHOD_MARKERS[name], markersize=6.5,
                        color=METHOD_COLOURS[name], fillstyle=cast(Any, style), label=method.label if full else None,
                    )  # fmt: skip
            name_lines(axes, args.functions)
            for line in range(1, len(args.functions)):
                axes.axhline(line - 0.5, color="#E4E4E4", linewidth=0.8)
            logarithmic(axes, "x")
            axes.set_title(f"d = {dimension}")
            axes.set_xlabel("evaluations to the target: mean")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        page = panels[0, 0].figure
        page.legend(handles, labels, loc="outside upper center", ncols=3, title="Hollow: some runs fail")


def draw_success(args: Namespace, results: Results, path: Path) -> None:
    """Success rates over distance (left) and dimension (right): a row for each method."""
    rates = {(row.task, row.method): row for row in results.rows if row.metric == SUCCESS_RATE}
    size = (9.6, 0.8 + 2.7 * len(args.methods))
    least = args.dimensions[0]
    with figure(path, [1.0] * len(args.methods), columns=2, size=size) as panels:
        for row, method in zip(panels, (METHODS[name] for name in args.methods), strict=True):

            def rate(function: str, dimension: int, distance: float, label: str = method.label) -> Row:
                return rates[f"{function}, d = {dimension}, distance {distance:g}", label]

            for number, function in enumerate(args.functions):
                by_distance = [rate(function, least, distance) for distance in args.distances]
                by_dimension = [rate(function, dimension, 1.0) for dimension in args.dimensions]
                curve(row[0], args.distances, by_distance, number, function)
                curve(row[1], args.dimensions, by_dimension, number, function)
            row[0].set_xscale("log")
            row[0].xaxis.set_major_locator(FixedLocator(args.distances))
            row[0].xaxis.set_minor_locator(NullLocator())
            row[0].set_xticks(args.distances, [f"{distance:g}" for distance in args.distances])
            row[1].set_xticks(args.dimensions)
            row[0].set_title(f"{method.label}, d = {least}")
            row[1].set_title(f"{method.label}, distance 1")
            for axes in row:
                axes.set_ylim(-0.04, 1.06)
                axes.set_yticks([0.0, 0.25, 0.5, 0.75, 1.0])
                axes.yaxis.set_major_formatter(PercentFormatter(1.0))
        panels[-1, 0].set_xlabel("distance of the start from the optimum")
        panels[-1, 1].set_xlabel("dimension d")
        page = panels[0, 0].figure
        page.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=4)


def _curves(results: Results) -> list[tuple[Problem, Curve]]:
    """The problem and the curve of each cell."""

    def both(cell: Cell, outcomes: Sequence[dict[str, Any]]) -> tuple[Problem, Curve]:
        problem = cast(Problem, cell.settings)
        return problem, summary(problem, outcomes)

    return [both(cell, outcomes) for cell, outcomes in zip(results.cells, results.outcomes, strict=True)]


def _draw_curve(axes: Axes, found: Curve, colour: str, label: str, target: float) -> None:
    """A median in a band of quartiles, to where the median run reaches the target."""
    at, median = found.evaluations, found.median
    known = np.isfinite(median)
    end = np.inf if found.reached is None else found.reached
    before = known & (at < end)
    x, y = at[before], median[before]
    if found.reached is not None and found.reached <= at[-1]:
        x, y = np.append(x, found.reached), np.append(y, target)
        axes.plot(found.reached, target, "o", color=colour, clip_on=False, zorder=4)
    axes.plot(x, y, color=colour, label=label, zorder=3)
    band = known & np.isfinite(found.high)
    band &= np.r_[True, found.high[:-1] > target]
    axes.fill_between(at[band], found.low[band], found.high[band], color=colour, alpha=0.2, linewidth=0)


def _finish(axes: Axes, shown: Sequence[Curve], dimension: int, target: float) -> None:
    """Scales and limits, when all curves are drawn."""
    ends = [found.reached for found in shown if found.reached is not None]
    last = float(SPAN * dimension)
    axes.set_xlim(0, min(last, 1.25 * max(ends)) if ends else last)
    axes.set_xlabel("evaluations")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value / 1000:g}k" if value else "0")
    if target > 0.0:
        axes.set_yscale("log")
        axes.set_ylim(bottom=target)
        axes.yaxis.set_major_locator(LogLocator(numticks=9))
        axes.yaxis.set_minor_locator(NullLocator())
    else:
        axes.set_yscale("symlog", linthresh=1.0)
        axes.set_ylim(target, 1e4)
        axes.set_yticks([-1000, -100, -10, 0, 10, 100, 1000], ["−1000", "−100", "−10", "0", "10", "100", "1000"])
        axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylabel("best cost")


def _kind(function: str) -> str:
    return "Bounded functions" if FUNCTIONS[function].target > 0.0 else "Unbounded ridges"


def draw_search(function: Function, course: Course, stds: float, path: Path) -> None:
    """Figure 4.4: the search distributions of one search in the plane, over the landscape, from light to dark.

    Args:
        function: The function that is minimised.
        course: The search, generation by generation.
        stds: Standard deviations that an ellipse shows.
        path: The file.
    """
    with figure(path, [1.0], size=(6.6, 6.2)) as panels:
        _draw_course(panels[0, 0], function, course, stds)


def _draw_course(axes: Axes, function: Function, course: Course, stds: float) -> None:
    low, high = np.array([-4.0, -1.5]), np.array([1.5, 4.0])
    x, y = (np.linspace(low[k], high[k], 400) for k in range(2))
    landscape = function(np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)).reshape(len(y), len(x))
    axes.contourf(x, y, landscape, levels=14, cmap="Greys", alpha=0.55)
    ordered = np.linspace(0.0, 1.0, len(course))
    for k in np.unique(np.linspace(0, len(course) - 1, DRAWN).astype(int)):
        mean, factor, _ = course[k]
        axes.add_patch(_ellipse(mean, factor, stds, float(ordered[k])))
    means = np.array([mean for mean, _, _ in course])
    axes.plot(*means.T, ".-", color=COLOURS[0], linewidth=1.0, markersize=4, zorder=4, label="mean")
    axes.plot(0, 0, "P", color=COLOURS[1], markersize=10, markeredgecolor="white", zorder=5, label="optimum")
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.grid(visible=False)
    axes.set_xlabel("$z_1$")
    axes.set_ylabel("$z_2$")
    axes.legend(loc="upper right", frameon=True, framealpha=1.0, edgecolor="white")


def _ellipse(mean: Vector, factor: Matrix, stds: float, age: float) -> Ellipse:
    """The points of a distribution that lie so many standard deviations from its mean."""
    vectors, lengths, _ = np.linalg.svd(factor)
    angle = np.degrees(np.arctan2(vectors[1, 0], vectors[0, 0]))
    width, height = 2.0 * stds * lengths
    return Ellipse(
        (float(mean[0]), float(mean[1])), width, height, angle=angle, fill=False,
        edgecolor=COLOURS[0], alpha=0.3 + 0.7 * age, linewidth=1.4, zorder=3,
    )  # fmt: skip
