"""What every table and figure has in common: cells, each filled by runs that differ in their seed only."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dpsearch.report.statistics import Statistic
from dpsearch.report.tables import SUCCESS_RATE, Row, Section
from scripts.experiments.jobs import Job, Outcome, Work
from scripts.experiments.training import Settings


@dataclass(frozen=True)
class Method:
    """A way to learn.

    Attributes:
        name: Short, for the command line and the log of runs.
        label: For tables and figures.
        overrides: Hydra's overrides that choose its settings.
    """

    name: str
    label: str
    overrides: tuple[str, ...]


@dataclass(frozen=True)
class Cell:
    """One method on one task.

    Attributes:
        task: What has to be learned.
        method: What learns.
        overrides: Hydra's overrides that choose the settings, the method's included.
        settings: What they come to.
        thesis: The thesis's numbers, by metric.
    """

    task: str
    method: Method
    overrides: tuple[str, ...]
    settings: Settings
    thesis: Mapping[str, float] = field(default_factory=dict)

    def jobs(self, work: Work, seeds: Sequence[int]) -> list[Job]:
        """A run for each seed."""
        config = self.settings.fingerprint()
        return [Job(self.task, self.method.name, config, self.overrides, seed, work) for seed in seeds]

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
            rows.append(blank(metric).with_values([outcome[metric] for outcome in solved], statistic))
        return rows


@dataclass(frozen=True)
class Experiment:
    """A table or figure.

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
        draw: Draws all these rows into a file.
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
    draw: Callable[[Namespace, list[Row], Path], None]
