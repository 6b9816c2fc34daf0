"""What every table and figure has in common: cells, each filled by runs that differ in their seed only."""

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
    """All that the runs of a cell depend on, their seeds aside."""

    def fingerprint(self) -> str:
        """Tells these settings from others."""

    @property
    def network(self) -> str:
        """The policy's architecture, in words; empty if there is no policy."""


@dataclass(frozen=True)
class Method:
    """A way to learn.

    Attributes:
        name: Short, for the command line and the log of runs.
        label: For tables and figures.
        overrides: Hydra's overrides that choose its settings, if these are Hydra's.
    """

    name: str
    label: str
    overrides: tuple[str, ...] = ()


@dataclass(frozen=True)
class Cell:
    """One method on one task.

    Attributes:
        task: What has to be learned.
        method: What learns.
        recipe: What chooses the settings, the method's included, when a run is made: Hydra's overrides, for example.
        settings: What they come to.
        thesis: The thesis's numbers, by metric; the standard deviation of a metric is ``metric_std``.
        work: What makes its runs; None for what makes those of the experiment.
    """

    task: str
    method: Method
    recipe: Hashable
    settings: Settings
    thesis: Mapping[str, float] = field(default_factory=dict)
    work: Work | None = None

    def jobs(self, work: Work, seeds: Sequence[int]) -> list[Job]:
        """A run for each seed, made by ``work`` if the cell has none of its own."""
        config, work = self.settings.fingerprint(), self.work or work
        return [Job(self.task, self.method.name, config, self.recipe, seed, work) for seed in seeds]

    def rows(self, outcomes: Sequence[Outcome], metrics: Sequence[str], statistic: Statistic) -> list[Row]:
        """What the runs come to: the success rate, then each metric over the successful ones."""

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
    """What the runs of an experiment come to.

    Attributes:
        cells: The cells.
        outcomes: The outcomes of each cell's runs.
        rows: All rows of the table, those that others report included.
    """

    cells: Sequence[Cell]
    outcomes: Sequence[Sequence[Outcome]]
    rows: Sequence[Row]


@dataclass(frozen=True)
class Experiment:
    """A table or figure made of many runs.

    Attributes:
        name: For the command line, and the stem of the files' names.
        title: One line.
        text: What the numbers are, for the page.
        runs: Runs of each cell unless said otherwise: the thesis's own number where it has one.
        statistic: What is shown of the runs, with its interval.
        metrics: The numbers of an outcome that are shown.
        words: For each metric, the heading of its column.
        run: Makes one run; called in another process, so a function of a module.
        add_options: Adds its own options to a parser.
        cells: The cells that the options ask for.
        sections: Arranges the rows, and adds those that others report.
        draw: Draws the results into a file.
        table: How the rows are laid out: ``Table``, or ``partial(Grid, ..)``.
        extra: What the JSON holds besides the rows.
        log: Stem of the name of the log of runs, which experiments may share; its own name if None.
        batch: How many runs are made in one go and noted in one line of the log, for runs of about a second.
        fewer: Fewer runs of some methods unless said otherwise.
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
        name: For the command line, and the stem of the files' names.
        title: One line.
        add_options: Adds its own options to a parser.
        make: Computes the page, given the options and the command line in words; draws its figure, if any.
        seed: Of its run, unless said otherwise.
    """

    name: str
    title: str
    add_options: Callable[[ArgumentParser], object]
    make: Callable[[Namespace, str], Document]
    seed: int = 0


def no_options(parser: ArgumentParser) -> None:
    """Of what leaves nothing to choose."""
