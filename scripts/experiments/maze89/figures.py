"""How results in the 89-state maze are drawn."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from dpsearch.report.figures import COLOURS, GREY, figure, name_lines
from scripts.experiments.experiment import Results

PANELS = {"goal": "reach the goal within 251 steps, %", "median": "median steps"}
HUMAN = {"goal": 100.0, "median": 29.0}


def draw_runs(args: Namespace, results: Results, path: Path) -> None:
    """Two panels, of goals and of medians: each run, sampled and greedy, with what a person achieves."""
    lines = [cell.method.label for cell in results.cells]
    with figure(path, [1, 1], size=(9.0, 2 * (0.9 + 0.3 * len(lines)))) as panels:
        for axes, (metric, words) in zip(panels[:, 0], PANELS.items(), strict=True):
            for place, outcomes in enumerate(results.outcomes):
                for kind, at, filled in (("sampled", place - 0.14, True), ("greedy", place + 0.2, False)):
                    values = [outcome[f"{kind}_{metric}"] for outcome in outcomes]
                    colour = COLOURS[place % len(COLOURS)] if filled else GREY
                    axes.plot(values, [at] * len(values), "|", color=colour, alpha=0.6, markersize=7)
                    axes.plot(
                        sum(values) / len(values),
                        at,
                        "o",
                        color=colour,
                        fillstyle="full" if filled else "none",
                        markersize=5,
                    )
            axes.axvline(HUMAN[metric], color="black", linewidth=0.8, linestyle=":")
            axes.set_xlabel(words)
            name_lines(axes, lines)
        panels[0, 0].figure.suptitle(
            "Runs and means, sampled (colour) and greedy (hollow); dotted: a person", fontsize=10
        )
