"""The figures of the T-maze."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.ticker import PercentFormatter

from dpsearch.report.figures import COLOURS, bars, curve, dots, figure, logarithmic
from dpsearch.report.tables import SUCCESS_RATE, Row
from scripts.experiments.experiment import Results
from scripts.experiments.learning import CORE_SECONDS, ENV_STEPS
from scripts.experiments.tmaze.reported import LONGEST, THESIS_RATES, task

Rows = dict[tuple[str, str, str], Row]  # by task, method and metric


def draw_corridors(args: Namespace, results: Results, path: Path) -> None:
    """Figure 3.4: steps until solved and success rate over the corridor's length, and how far each method gets."""
    found, corridors = _index(results.rows), args.corridors
    with figure(path, (3.2, 1.9, 1.4), size=(8.0, 8.4)) as panels:
        steps, rates, reach = panels[:, 0]
        for k, method in enumerate(args.methods):
            for axes, metric in ((steps, ENV_STEPS), (rates, SUCCESS_RATE)):
                line = [found[task(corridor), method.label, metric] for corridor in corridors]
                curve(axes, corridors, line, k, method.label)
        reported = [corridor for corridor in corridors if corridor in THESIS_RATES]
        theirs = [THESIS_RATES[corridor] for corridor in reported]
        label = "RPG, reported in the thesis"
        rates.plot(reported, theirs, "D", color="black", fillstyle="none", markersize=9, zorder=4, label=label)
        steps.set_title("Environment steps until solved: mean, 95% interval")
        logarithmic(steps, "y")
        rates.set_title("Runs that solve the task, 95% interval")
        rates.set_ylim(-0.05, 1.1)
        rates.set_yticks([0.0, 0.25, 0.5, 0.75, 1.0])
        rates.yaxis.set_major_formatter(PercentFormatter(1.0))
        _draw_reach(reach, args, results.rows)
        for axes in (steps, rates, reach):
            axes.set_xlim(0, max(*corridors, 100) + 5)
            axes.set_xlabel("corridor length N")
        steps.figure.legend(*rates.get_legend_handles_labels(), loc="outside upper center", ncols=3)


def draw_long(args: Namespace, results: Results, path: Path) -> None:
    """Steps until solved in long corridors, and how far each method gets."""
    found = _index(results.rows)
    lines = [
        (f"{method.label}, N = {corridor:,}", found[task(corridor), method.label, ENV_STEPS], COLOURS[k])
        for k, method in enumerate(args.methods)
        for corridor in args.corridors
    ]
    with figure(path, (len(lines), 3 + len(args.methods)), size=(8.0, 3.0 + 0.4 * len(lines))) as panels:
        steps, reach = panels[:, 0]
        dots(steps, lines)
        logarithmic(steps, "x")
        steps.set_title("Environment steps until solved: median, 95% interval")
        reach.set_xlim(1, 2 * max(*args.corridors, 100))
        _draw_reach(reach, args, results.rows)
        logarithmic(reach, "x")
        reach.set_xlabel("corridor length N")


def draw_peers(args: Namespace, results: Results, path: Path) -> None:
    """Steps and core-seconds until solved, beside what peers need."""
    found, labels = _index(results.rows), list(dict.fromkeys(row.method for row in results.rows))
    height = 0.6 + len(args.corridors) * (0.7 + 0.32 * len(labels))
    with figure(path, [1] * len(args.corridors), columns=2, size=(9.0, height)) as panels:
        for k, corridor in enumerate(args.corridors):
            for axes, metric in zip(panels[k], (ENV_STEPS, CORE_SECONDS), strict=True):
                entries = [found.get((task(corridor), label, metric)) for label in labels]
                dots(axes, list(zip(labels, entries, COLOURS, strict=False)))
                logarithmic(axes, "x")
                words = "Environment steps" if metric == ENV_STEPS else "Core-seconds"
                axes.set_title(f"{words} until solved, N = {corridor}")
            panels[k, 1].set_yticklabels([])
        panels[0, 0].figure.suptitle("Full: measured, median with 95% interval. Hollow: reported.", fontsize=10)


def _draw_reach(axes: Axes, args: Namespace, rows: Sequence[Row]) -> None:
    """The longest corridor that each method solves."""
    labels = [method.label for method in args.methods]
    entries: list[tuple[str, float, str | None]] = []
    for row in (row for row in rows if row.metric == LONGEST):
        if row.mean is not None:
            entries.append((row.method, row.mean, COLOURS[labels.index(row.method)]))
        if row.thesis is not None:
            entries.append((f"{row.method}, thesis", row.thesis, None))
    bars(axes, entries)
    axes.set_title("Longest corridor solved reliably (hatched: reported)")


def _index(rows: Sequence[Row]) -> Rows:
    return {(row.task, row.method, row.metric): row for row in rows}
