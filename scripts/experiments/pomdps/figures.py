"""The figure of each table of small POMDPs."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import cast

from matplotlib.axes import Axes
from matplotlib.ticker import PercentFormatter

from dpsearch.report.figures import GREY, figure, name_lines
from scripts.experiments.experiment import Results
from scripts.experiments.pomdps.runs import SHARE
from scripts.experiments.sampled_and_greedy import draw_both

COLUMNS = 3
LOWEST = -0.1  # a policy that is much worse than random is drawn here


def draw_shares(args: Namespace, results: Results, path: Path) -> None:
    """A panel for each task: how far from random to optimal each run went, sampled and greedy, with the means."""
    lines = [method.label for method in args.methods]
    rows = -(-len(args.tasks) // COLUMNS)
    size = (10.0, rows * (0.9 + 0.26 * len(lines)))
    with figure(path, [1] * rows, columns=COLUMNS, size=size) as panels:
        for k, (panel, task) in enumerate(zip(panels.flat, args.tasks, strict=False)):
            axes = cast(Axes, panel)
            for cell, outcomes in zip(results.cells, results.outcomes, strict=True):
                if cell.task != task.label:
                    continue
                draw_both(axes, lines.index(cell.method.label), outcomes, SHARE, lowest=LOWEST)
            axes.set_title(task.label)
            axes.axvline(1.0, color="black", linewidth=0.8)
            axes.axvline(task.goal, color=GREY, linewidth=0.8, linestyle=":")
            axes.set_xlim(LOWEST - 0.03, 1.06)
            axes.xaxis.set_major_formatter(PercentFormatter(1.0))
            name_lines(axes, lines if k % COLUMNS == 0 else [""] * len(lines))
        for unused in panels.flat[len(args.tasks) :]:
            unused.set_visible(False)
        words = "From random (0%) to optimal (100%): runs and means, sampled (colour) and greedy (hollow)"
        panels[0, 0].figure.suptitle(words, fontsize=10)
