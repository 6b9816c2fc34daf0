"""Tables and figures as data: cells, each filled by runs that differ in their seed only."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

from dpsearch.report.document import Document
from dpsearch.report.statistics import Statistic
from dpsearch.report.tables import SUCCESS_RATE, Row, Section, Table
from scripts.experiments.jobs import Job, Outcome, Work


class Settings(Protocol):
    """Everything that the runs of a cell depend on, their seeds aside."""

    def fingerprint(self) -> str:
        """Tells these settings from others."""

    @property
    def network(self) -> str:
        """The policy's architecture, in words; empty if there is no policy."""


@dataclass(frozen=True)
class Method:
    """A way to learn.

    Attributes:
        name: Short name, for the command line and the log of runs.
        label: Name in tables and figures.
        overrides: Hydra's overrides that choose the settings, if these are Hydra's.
    """

    name: str
    label: str
    overrides: tuple[str, ...] = ()


@dataclass(frozen=True)
class Cell:
    """One method on one task.

    Attributes:
        task: Name of the task.
        method: The method that learns it.
        recipe: Argument of the function that makes a run: Hydra's overrides, the method's included, for example.
        settings: Settings that the recipe stands for.
        thesis: The thesis's numbers, by metric; the standard deviation of a metric is ``metric_std``.
        work: Function that makes this cell's runs; None for the experiment's own.
    """

    task: str
    method: Method
    recipe: Hashable
    settings: Settings
    thesis: Mapping[str, float] = field(default_factory=dict)
    work: Work | None = None

    def jobs(self, work: Work, seeds: Sequence[int]) -> list[Job]:
        """A run for each seed, made by ``work`` if the cell has no function of its own."""
        config, work = self.settings.fingerprint(), self.work or work
        return [Job(self.task, self.method.name, config, self.recipe, seed, work) for seed in seeds]

    def rows(self, outcomes: Sequence[Outcome], metrics: Sequence[str], statistic: Statistic) -> list[Row]:
        """Lines of the table: the success rate of the runs, then each metric over the successful ones."""

        def blank(metric: str) -> Row:
            return Row(
                task=self.task,
                method=self.method.label,
                network=self.settings.network,
                metric=metric,
                runs=len(outcomes),
                thesis=self.thesis.get(metric),
            )

        solved = [outcome for outcome in outcomes if outcome["solved"]]
        rows = [blank(SUCCESS_RATE).with_successes(len(solved))]
        for metric in metrics:
            row = blank(metric).with_values([outcome[metric] for outcome in solved], statistic)
            rows.append(row)
            if f"{metric}_std" in self.thesis:
                rows.append(replace(blank(f"{metric}_std"), solved=row.solved, mean=row.std))
        return rows


@dataclass(frozen=True)
class Results:
    """The outcomes of an experiment's runs, and the rows made of them.

    Attributes:
        cells: The cells.
        outcomes: The outcomes of each cell's runs.
        rows: All rows of the table, numbers that others report included.
    """

    cells: Sequence[Cell]
    outcomes: Sequence[Sequence[Outcome]]
    rows: Sequence[Row]


@dataclass(frozen=True)
class Experiment:
    """A table or figure made of many runs.

    Attributes:
        name: Name on the command line, and stem of the files' names.
        title: Title of the page, one line.
        text: Explains the numbers, on the page.
        runs: Default number of runs in each cell: the thesis's own where it has one.
        statistic: Mean or median, which is shown of the runs with its interval.
        metrics: Keys of the numbers in an outcome that are shown.
        words: Heading of the column of each metric.
        run: Function that makes one run; another process calls it, so it must belong to a module.
        add_options: Adds the experiment's own options to a parser.
        cells: The cells that the options ask for.
        sections: Arranges the rows in sections, and adds numbers that others report.
        draw: Draws the results into a file.
        table: How the rows are laid out: ``Table``, or ``partial(Grid, ..)``.
        extra: Computes further content of the JSON, besides the rows.
        log: Stem of the log's file name, which experiments may share; None for the experiment's own name.
        batch: Number of runs made in one go and noted in one line of the log, for runs of about a second.
        fewer: Default numbers of runs of those methods that have fewer.
    """

    name: str
    title: str
    text: str
    runs: int
    statistic: Statistic
    metrics: Sequence[str]
    words: dict[str, str]
    run: Work
    add_options: Callable[[ArgumentParser], object]
    cells: Callable[[Namespace], list[Cell]]
    sections: Callable[[Namespace, list[Row]], list[Section]]
    draw: Callable[[Namespace, Results, Path], None]
    table: Callable[..., Table] = Table
    extra: Callable[[Results], dict[str, Any]] | None = None
    log: str | None = None
    batch: int = 1
    fewer: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Illustration:
    """A table or figure that needs no more than one quick run.

    Attributes:
        name: Name on the command line, and stem of the files' names.
        title: Title of the page, one line.
        add_options: Adds the illustration's own options to a parser.
        make: Computes the page, given the options and the command line in words; draws its figure, if any.
        seed: Default seed of the run.
    """

    name: str
    title: str
    add_options: Callable[[ArgumentParser], object]
    make: Callable[[Namespace, str], Document]
    seed: int = 0


def no_options(parser: ArgumentParser) -> None:
    """Add nothing: there is nothing to choose."""


def reported(task: str, method: str, metric: str, value: float) -> Row:
    """A row with a number that others report."""
    return Row(task=task, method=method, network="", metric=metric).with_report(value, value)
