"""How results on small POMDPs are drawn."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import cast

from matplotlib.axes import Axes
from matplotlib.ticker import PercentFormatter

from dpsearch.report.figures import COLOURS, GREY, figure, name_lines
from scripts.experiments.experiment import Results

COLUMNS = 3
LOWEST = -0.1  # what is worse than random is drawn here


def draw_shares(args: Namespace, results: Results, path: Path) -> None:
    """A panel for each task: how far from random to optimal each run went, sampled and greedy, with the means."""
    lines = [method.label for method in args.methods]
    rows = -(-len(args.tasks) // COLUMNS)
    size = (10.0, rows * (0.9 + 0.26 * len(lines)))
    with figure(path, [1] * rows, columns=COLUMNS, size=size) as panels:
        for panel, task in zip(panels.flat, args.tasks, strict=False):
            axes = cast(Axes, panel)
            for cell, outcomes in zip(results.cells, results.outcomes, strict=True):
                if cell.task != task.label:
                    continue
                place = lines.index(cell.method.label)
                for kind, at, filled in (("sampled", place - 0.14, True), ("greedy", place + 0.2, False)):
                    shares = [max(outcome[f"{kind}_share"], LOWEST) for outcome in outcomes]
                    colour = COLOURS[place % len(COLOURS)] if filled else GREY
                    axes.plot(shares, [at] * len(shares), "|", color=colour, alpha=0.5, markersize=6)
                    mean = sum(shares) / len(shares)
                    axes.plot(mean, at, "o", color=colour, fillstyle="full" if filled else "none", markersize=5)
            axes.set_title(task.label)
            axes.axvline(1.0, color="black", linewidth=0.8)
            axes.axvline(task.goal, color=GREY, linewidth=0.8, linestyle=":")
            axes.set_xlim(LOWEST - 0.03, 1.06)
            axes.xaxis.set_major_formatter(PercentFormatter(1.0))
            name_lines(axes, lines)
        for axes in panels.flat[len(args.tasks) :]:
            axes.set_visible(False)
