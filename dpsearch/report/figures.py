"""The look of figures: colours that all eyes tell apart, bands for intervals, hollow marks for what others report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from dpsearch.report.tables import Row

# Okabe and Ito's palette, for colour-blind and other eyes, in an order that also works in print
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
GREY = "#5F5F5F"
MARKERS = ("o", "s", "^", "D", "v", "P")

STYLE: Any = {  # matplotlib's releases disagree about its type
    "font.size": 10,
    "axes.titlesize": 11,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": GREY,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "axes.axisbelow": True,
    "grid.color": "#E4E4E4",
    "xtick.color": GREY,
    "ytick.color": GREY,
    "xtick.labelcolor": "black",
    "ytick.labelcolor": "black",
    "legend.frameon": False,
    "lines.linewidth": 2.0,
    "lines.markersize": 6,
}


@contextmanager
def figure(
    path: Path, heights: Sequence[float], *, columns: int = 1, size: tuple[float, float]
) -> Iterator[NDArray[np.object_]]:
    """Context of a figure with panels, which is written to a file at the end.

    Args:
        path: The file.
        heights: Relative heights of the rows of panels.
        columns: Panels in a row.
        size: Width and height of the whole, in inches.

    Yields:
        ``(rows, columns)`` axes.
    """
    with mpl.rc_context(STYLE):
        page = Figure(figsize=size, layout="constrained")
        yield page.subplots(len(heights), columns, squeeze=False, height_ratios=heights)
        page.savefig(path, dpi=200)


def curve(axes: Axes, x: Sequence[float], rows: Sequence[Row], number: int, label: str) -> None:
    """Means, joined by a line, in a band that shows their intervals.

    Args:
        axes: Panel to draw in.
        x: Horizontal positions, ``(N,)``.
        rows: Rows of results, ``(N,)``; those without a mean are left out.
        number: Number of the colour and marker.
        label: Text in the legend.
    """
    points = [
        (at, row.mean, *_interval(row, row.mean)) for at, row in zip(x, rows, strict=True) if row.mean is not None
    ]
    if not points:
        return
    at, means, low, high = np.array(points).T
    colour = COLOURS[number]
    axes.fill_between(at, low, high, color=colour, alpha=0.2, linewidth=0)
    axes.plot(at, means, color=colour, marker=MARKERS[number], label=label, clip_on=False, zorder=3)


def dots(axes: Axes, rows: Sequence[tuple[str, Row | None, str]]) -> None:
    """Medians with their intervals, one below the other; results that others report are hollow and grey.

    Args:
        axes: Panel to draw in.
        rows: Label, row and colour of each line, from top to bottom.
    """
    for place, (_, row, colour) in enumerate(rows):
        if row is None or (row.median is None and row.ci_low is None):
            words = "no number" if row is None or row.runs is None else "no run solved it"
            at = ("axes fraction", "data")
            axes.annotate(words, (0.03, place), xycoords=at, va="center_baseline", color=GREY)
        elif row.runs is not None and row.median is not None:
            axes.plot(
                _interval(row, row.median), [place, place], color=colour, linewidth=6, alpha=0.3, solid_capstyle="butt"
            )
            axes.plot(row.median, place, "o", color=colour, markersize=8)
        elif row.median is not None:
            axes.plot(row.median, place, "D", color=GREY, fillstyle="none", markersize=7)
        elif row.ci_low is not None and row.ci_high is not None:
            axes.plot([row.ci_low, row.ci_high], [place, place], "|-", color=GREY, markersize=11)
        elif row.ci_low is not None:
            axes.plot(row.ci_low, place, ">", color=GREY, fillstyle="none", markersize=8)
            axes.annotate(
                "not solved by", (row.ci_low, place), (-9, 0), textcoords="offset points",
                ha="right", va="center_baseline", color=GREY,
            )  # fmt: skip
    name_lines(axes, [label for label, _, _ in rows])


def bars(axes: Axes, rows: Sequence[tuple[str, float, str | None]]) -> None:
    """Horizontal bars labelled with their lengths, hatched for results that others report.

    Args:
        axes: Panel to draw in.
        rows: Label, length and colour of each bar, from top to bottom; None as colour if others report it.
    """
    for place, (_, length, colour) in enumerate(rows):
        hatch, face, edge = ("////", "none", GREY) if colour is None else (None, colour, colour)
        axes.barh(place, length, height=0.62, linewidth=1.0, hatch=hatch, facecolor=face, edgecolor=edge)
        at = max(length, axes.get_xlim()[0])
        axes.annotate(f"{length:,.0f}", (at, place), (4, 0), textcoords="offset points", va="center_baseline")
    name_lines(axes, [label for label, _, _ in rows])


def name_lines(axes: Axes, labels: Sequence[str]) -> None:
    """Name the lines of a panel, from top to bottom."""
    axes.set_yticks(range(len(labels)), labels)
    axes.set_ylim(len(labels) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.grid(visible=True, axis="x")


def logarithmic(axes: Axes, direction: Literal["x", "y"]) -> None:
    """Make an axis logarithmic, with labels that read 20k and 1M; last, when all is drawn."""
    if direction == "x":
        axes.set_xscale("log")
    else:
        axes.set_yscale("log")
    axis = axes.xaxis if direction == "x" else axes.yaxis
    low, high = axis.get_view_interval()
    decades = np.log10(high / low)
    steps = (1.0, 2.0, 5.0) if decades < 2 else (1.0, 3.0) if decades < 3 else (1.0,)
    axis.set_major_locator(LogLocator(subs=steps))
    axis.set_major_formatter(_short)
    axis.set_minor_locator(NullLocator())


def _short(value: float, _: float) -> str:
    for size, letter in ((1e6, "M"), (1e3, "k")):
        if value >= size:
            return f"{value / size:g}{letter}"
    return f"{value:g}"


def _interval(row: Row, centre: float) -> tuple[float, float]:
    return (centre if row.ci_low is None else row.ci_low, centre if row.ci_high is None else row.ci_high)
