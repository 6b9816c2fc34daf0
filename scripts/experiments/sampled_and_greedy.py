"""Policies judged twice: with sampled actions, as they were trained, and with their most likely ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from dpsearch.report.figures import COLOURS, GREY
from scripts.experiments.jobs import Outcome

SAMPLED, GREEDY = "sampled", "greedy"
KINDS = (SAMPLED, GREEDY)


def of_both(names: Sequence[str]) -> tuple[str, ...]:
    """The keys of an outcome for these metrics: ``sampled_NAME`` of all, then ``greedy_NAME`` of all."""
    return tuple(f"{kind}_{name}" for kind in KINDS for name in names)


def draw_both(axes: Axes, place: int, outcomes: Sequence[Outcome], name: str, *, lowest: float = -np.inf) -> None:
    """Draw a line of a panel: each run as a tick and their mean as a dot, sampled in colour, greedy grey and hollow.

    Args:
        axes: The panel.
        place: Number of the line, from the top.
        outcomes: Outcomes of the runs.
        name: The metric.
        lowest: Values below it are drawn there.
    """
    styles = ((SAMPLED, place - 0.14, COLOURS[place % len(COLOURS)], True), (GREEDY, place + 0.2, GREY, False))
    for kind, at, colour, filled in styles:
        values = np.array([outcome[f"{kind}_{name}"] for outcome in outcomes])
        axes.plot(np.maximum(values, lowest), [at] * len(values), "|", color=colour, alpha=0.5, markersize=6)
        axes.plot(
            max(values.mean(), lowest), at, "o",
            color=colour, fillstyle="full" if filled else "none", markersize=5,
        )  # fmt: skip
