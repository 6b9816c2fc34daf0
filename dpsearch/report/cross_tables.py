"""Tables with a column for each method or task, where there are many cells and one number in each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from dpsearch.report.tables import SUCCESS_RATE, Row, Table, number, percent

Key = tuple[str, str]  # line and column


@dataclass(frozen=True)
class Grid(Table):
    """A table whose rows say in which line and column they stand.

    A cell holds the number of its metric, with its spread and interval, and how many runs it is over, unless it is
    over all. A column is followed by the thesis's where that has numbers.

    Attributes:
        line: Function from a row to the heading of its line.
        column: Function from a row to the heading of its column.
        corner: Heading of the first column.
    """

    line: Callable[[Row], str] = lambda row: row.task
    column: Callable[[Row], str] = lambda row: row.method
    corner: str = "task"

    def _lines(self, rows: Sequence[Row]) -> str:
        cells: dict[Key, dict[str, Row]] = {}
        for row in rows:
            cells.setdefault((self.line(row), self.column(row)), {})[row.metric] = row
        lines, columns = (list(dict.fromkeys(names)) for names in zip(*cells, strict=True))
        with_thesis = {
            column for (_, column), cell in cells.items() if any(row.thesis is not None for row in cell.values())
        }
        head, texts = [self.corner], [[line] for line in lines]
        for column in columns:
            head.append(column)
            for text, line in zip(texts, lines, strict=True):
                text.append(self._cell(cells.get((line, column), {})))
            if column in with_thesis:
                head.append("thesis")
                for text, line in zip(texts, lines, strict=True):
                    text.append(self._thesis(cells.get((line, column), {})))
        ruler = ["---", *("---:" for _ in head[1:])]
        return "\n".join("| " + " | ".join(text) + " |" for text in (head, ruler, *texts))

    def _cell(self, cell: Mapping[str, Row]) -> str:
        rate = cell.get(SUCCESS_RATE)
        rows = [cell[metric] for metric in self.words if metric in cell and metric != SUCCESS_RATE]
        if not rows:
            return "" if rate is None or rate.mean is None else percent(rate.mean) + _interval(rate, percent)
        numbers = "; ".join(filter(None, (self._number(row) for row in rows)))
        runs, solved = (rows[0].runs, rows[0].solved) if rate is None else (rate.runs, rate.solved)
        return numbers if runs is None or runs == solved else f"{numbers} ({solved} of {runs})"

    def _number(self, row: Row) -> str:
        centre = row.median if self.statistic == "median" or row.runs is None else row.mean
        if row.runs is None:
            return "" if centre is None else f"*{number(centre)}*"
        if centre is None:
            return "–"
        spread = f" ± {number(row.std)}" if self.statistic == "mean" and row.std is not None else ""
        return f"{number(centre)}{spread}{_interval(row, number)}"

    def _thesis(self, cell: Mapping[str, Row]) -> str:
        """The thesis's numbers: 1,443 ± 521 (76%)."""
        parts = []
        for metric in self.words:
            if metric in cell and metric != SUCCESS_RATE and (theirs := cell[metric].thesis) is not None:
                spread = cell.get(f"{metric}_std")
                parts.append(
                    number(theirs) + ("" if spread is None or spread.thesis is None else f" ± {number(spread.thesis)}")
                )
        rate = cell.get(SUCCESS_RATE)
        if rate is not None and rate.thesis is not None:
            parts.append(f"({percent(rate.thesis)})" if parts else percent(rate.thesis))
        return " ".join(parts)


def _interval(row: Row, show: Callable[[float], str]) -> str:
    return "" if row.ci_low is None or row.ci_high is None else f" [{show(row.ci_low)}, {show(row.ci_high)}]"
