"""The figures of the 89-state maze."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from dpsearch.report.figures import COLOURS, figure, name_lines
from scripts.experiments.experiment import Results
from scripts.experiments.maze89.reported import HUMAN_GOAL, HUMAN_MEDIAN
from scripts.experiments.maze89.runs import GOAL, MEDIAN
from scripts.experiments.maze89.variance import CONSTANT, HISTORY, WORDS
from scripts.experiments.sampled_and_greedy import draw_both

PANELS = (
    (GOAL, "reach the goal within 251 steps, %", HUMAN_GOAL),
    (MEDIAN, "median steps", HUMAN_MEDIAN),
)


def draw_runs(args: Namespace, results: Results, path: Path) -> None:
    """Two panels, of goals and of medians: each run, sampled and greedy, beside a person's."""
    lines = [cell.method.label for cell in results.cells]
    with figure(path, [1, 1], size=(9.0, 2 * (0.9 + 0.3 * len(lines)))) as panels:
        for axes, (metric, words, human) in zip(panels[:, 0], PANELS, strict=True):
            for place, outcomes in enumerate(results.outcomes):
                draw_both(axes, place, outcomes, metric)
            axes.axvline(human, color="black", linewidth=0.8, linestyle=":")
            axes.set_xlabel(words)
            name_lines(axes, lines)
        panels[0, 0].figure.suptitle(
            "Runs and means, sampled (colour) and greedy (hollow); dotted: a person", fontsize=10
        )


def draw_variance(args: Namespace, results: Results, path: Path) -> None:
    """Ratio of the variance with each baseline to the variance without: a dot for each run, by stage."""
    with figure(path, [1], size=(7.0, 3.2)) as panels:
        axes = panels[0, 0]
        for k, name in enumerate((CONSTANT, HISTORY)):
            for place, outcomes in enumerate(results.outcomes):
                values = [outcome[name] for outcome in outcomes]
                axes.plot([place + 0.1 * k] * len(values), values, "o", color=COLOURS[k], alpha=0.6,
                          label=WORDS[name] if place == 0 else None)  # fmt: skip
        axes.set_xticks(range(len(results.cells)), [cell.method.label for cell in results.cells])
        axes.axhline(1.0, color="black", linewidth=0.8)
        axes.set_ylim(0.0)
        axes.set_ylabel("variance of the gradient")
        axes.legend(frameon=False)
