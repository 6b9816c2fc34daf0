"""Tables of results: one row for each task, method and metric, written as JSON for machines and Markdown for people.

A row is *measured* here, over a number of runs, or *reported* by somebody else; a reported row has no ``runs``, and
only those numbers that were given.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Self

import numpy as np

from dpsearch.report.document import Document
from dpsearch.report.statistics import Statistic, bootstrap_interval, success_interval

SUCCESS_RATE = "success_rate"


@dataclass(frozen=True, kw_only=True)
class Row:
    """One metric of one method on one task.

    Attributes:
        task: Name of the task.
        method: Name of the method.
        network: Architecture of the network.
        metric: Name of the metric.
        runs: Number of runs; None if others report the numbers.
        solved: Number of runs that succeeded. As in the thesis, only the success rate is over all runs, other
            numbers are over these.
        mean: Mean of the runs.
        std: Standard deviation of the sample of runs.
        median: Median of the runs.
        ci_low: Lower end of the 95% interval, or of the range that others report.
        ci_high: Upper end of the 95% interval, or of the range that others report.
        thesis: The thesis's number.
    """

    task: str
    method: str
    network: str
    metric: str
    runs: int | None = None
    solved: int | None = None
    mean: float | None = None
    std: float | None = None
    median: float | None = None
    ci_low: float | None = None
    ci_high: float | None = None
    thesis: float | None = None

    def with_values(self, values: Sequence[float], statistic: Statistic) -> Self:
        """This row with mean, median and deviation of values, one for each success; the statistic has the interval."""
        low, high = bootstrap_interval(values, statistic) or (None, None)
        return replace(
            self,
            solved=len(values),
            mean=float(np.mean(values)) if values else None,
            std=float(np.std(values, ddof=1)) if len(values) > 1 else None,
            median=float(np.median(values)) if values else None,
            ci_low=low,
            ci_high=high,
        )

    def with_successes(self, solved: int) -> Self:
        """This row with the rate of success of its runs."""
        assert self.runs is not None
        low, high = success_interval(solved, self.runs)
        return replace(self, solved=solved, mean=solved / self.runs, ci_low=low, ci_high=high)

    def with_report(self, low: float, high: float | None) -> Self:
        """This row with others' numbers: a range, one number twice, or, if ``high`` is None, no success by ``low``."""
        if high is None:
            return replace(self, solved=0, ci_low=low)
        if low == high:
            return replace(self, median=low)
        return replace(self, ci_low=low, ci_high=high)


@dataclass(frozen=True)
class Section:
    """A section of a table: rows under one heading.

    Attributes:
        heading: Heading of the section.
        rows: The rows; those of one task, method and network share a line of the table.
    """

    heading: str
    rows: Sequence[Row]


@dataclass(frozen=True)
class Table:
    """The results of one experiment.

    Attributes:
        name: Name of the experiment, and the stem of its files' names.
        title: Title of the page, one line.
        text: Explanation of the numbers, in Markdown.
        command: Command line that computes the numbers again.
        versions: Versions of all that the numbers depend on.
        machine: Machine that computed the numbers, on which core-seconds were counted.
        words: Heading of each metric's column, in the order of the columns.
        statistic: Statistic that has the intervals: "mean" or "median".
        sections: Sections of rows.
        extra: Further contents of the JSON file.
    """

    name: str
    title: str
    text: str
    command: str
    versions: dict[str, str]
    machine: str
    words: dict[str, str]
    statistic: Statistic
    sections: Sequence[Section]
    extra: Mapping[str, Any] = field(default_factory=dict)

    @property
    def rows(self) -> list[Row]:
        """The rows of all sections."""
        return [row for section in self.sections for row in section.rows]

    def document(self) -> Document:
        """The page with this table."""
        sections = [f"## {section.heading}\n\n{self._lines(section.rows)}" for section in self.sections]
        rows = [asdict(row) for row in self.rows]
        return Document(
            name=self.name,
            title=self.title,
            text="\n\n".join([self.text, *sections]),
            content={"interval": f"95%, of the {self.statistic}", "rows": rows, **self.extra},
            command=self.command,
            versions=self.versions,
            machine=self.machine,
            figure=True,
        )

    def _lines(self, rows: Sequence[Row]) -> str:
        """Rows as Markdown, with a column for each metric, and one for the thesis's numbers where it has any."""
        lines: dict[tuple[str, str, str], dict[str, Row]] = {}
        for row in rows:
            lines.setdefault((row.task, row.method, row.network), {})[row.metric] = row
        columns: list[tuple[str, str, Callable[[Row, Statistic], str]]] = []
        for metric, heading in self.words.items():
            own = [row for row in rows if row.metric == metric]
            if own:
                columns.append((heading, metric, _value))
            if any(row.thesis is not None for row in own):
                columns.append(("thesis", metric, _thesis))
        head = ["task", "method", "network", *(heading for heading, _, _ in columns)]
        ruler = ["---", "---", "---", *("---:" for _ in columns)]
        body = [
            [*names, *(cell(line[metric], self.statistic) if metric in line else "" for _, metric, cell in columns)]
            for names, line in lines.items()
        ]
        return "\n".join("| " + " | ".join(cells) + " |" for cells in (head, ruler, *body))


def number(value: float) -> str:
    """A number with three significant digits, in full: 105,000 or 9.81."""
    return f"{float(f'{value:.3g}'):,.12g}"


def percent(rate: float) -> str:
    """A rate between 0 and 1, in percent."""
    return f"{number(100 * rate)}%"


def _thesis(row: Row, _: Statistic) -> str:
    return "" if row.thesis is None else _words(row)(row.thesis)


def _value(row: Row, statistic: Statistic) -> str:
    if row.runs is None:
        return _reported(row)
    show = _words(row)
    interval = "" if row.ci_low is None or row.ci_high is None else f" [{show(row.ci_low)}, {show(row.ci_high)}]"
    if row.metric == SUCCESS_RATE:
        return f"{row.solved} of {row.runs}{interval}"
    centre = row.median if statistic == "median" else row.mean
    if centre is None:
        return "–"
    spread = f" ± {show(row.std)}" if statistic == "mean" and row.std is not None else ""
    return f"{show(centre)}{spread}{interval}"


def _reported(row: Row) -> str:
    show = _words(row)
    if row.median is not None:
        return f"*{show(row.median)}*"
    if row.ci_low is None:
        return ""
    return f"*> {show(row.ci_low)}*" if row.ci_high is None else f"*{show(row.ci_low)} to {show(row.ci_high)}*"


def _words(row: Row) -> Callable[[float], str]:
    return percent if row.metric == SUCCESS_RATE else number
