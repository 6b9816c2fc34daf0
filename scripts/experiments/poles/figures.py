"""The figure of each table of pole balancing."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from dpsearch.report.figures import COLOURS, GREY, figure, logarithmic, name_lines
from scripts.experiments.experiment import Results


def draw_evaluations(args: Namespace, results: Results, path: Path) -> None:
    """A panel for each task: every run that succeeded, the quartiles, and numbers that are reported."""
    tasks = list(dict.fromkeys(cell.task for cell in results.cells))
    methods = list(dict.fromkeys(row.method for row in results.rows))
    found = {task: {row.method for row in results.rows if row.task == task} for task in tasks}
    heights = [0.7 + 0.34 * len(found[task]) for task in tasks]
    with figure(path, heights, size=(8.0, 1.0 + sum(heights))) as panels:
        for axes, task in zip(panels[:, 0], tasks, strict=True):
            lines = [method for method in methods if method in found[task]]
            for cell, outcomes in zip(results.cells, results.outcomes, strict=True):
                if cell.task != task:
                    continue
                place = lines.index(cell.method.label)
                colour = COLOURS[methods.index(cell.method.label) % len(COLOURS)]
                values = [outcome["evaluations"] for outcome in outcomes if outcome["solved"]]
                if values:
                    axes.plot(values, [place] * len(values), "|", color=colour, alpha=0.35, markersize=9)
                    axes.boxplot(
                        values, positions=[place], orientation="horizontal", widths=0.5, showfliers=False,
                        whis=(5, 95), medianprops={"color": "black", "linewidth": 2}, manage_ticks=False,
                        boxprops={"color": colour}, whiskerprops={"color": colour}, capprops={"color": colour},
                    )  # fmt: skip
                failed = len(outcomes) - len(values)
                if failed:
                    at = ("axes fraction", "data")
                    axes.annotate(f"{failed} of {len(outcomes)} failed", (1.01, place), xycoords=at,
                                  ha="left", va="center_baseline", color=GREY, fontsize=8)  # fmt: skip
                theirs = cell.thesis.get("evaluations")
                if theirs is not None:
                    axes.plot(theirs, place, "D", color="black", fillstyle="none", markersize=8, zorder=4)
            for row in results.rows:
                if row.task == task and row.runs is None and row.metric == "evaluations" and row.median is not None:
                    axes.plot(row.median, lines.index(row.method), "D", color=GREY, fillstyle="none", markersize=8)
            name_lines(axes, lines)
            axes.set_title(task)
            axes.set_xlabel("evaluations until success")
            logarithmic(axes, "x")
        panels[0, 0].figure.suptitle("Runs, quartiles, 5% and 95%. Hollow: reported.", fontsize=10)
