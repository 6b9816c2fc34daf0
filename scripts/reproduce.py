"""Computes a table or figure again: ``python scripts/reproduce.py fig_3_4 --jobs 8``; ``all`` computes every one.

The results go to ``docs/results/NAME.json``, ``.md`` and ``.png``. Every run that is finished is noted in
``NAME.runs.jsonl`` at once and never made again, so the same command goes on where an earlier one was interrupted;
figures that show the same runs share one such log. ``all`` computes each page by the command that the page names, or by
default options where there is no page yet.
"""

from __future__ import annotations

import json
import os
import shlex
import signal
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from pathlib import Path

from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # Python itself looks into scripts/ only

from dpsearch.files import versions
from dpsearch.report.document import Document
from dpsearch.report.provenance import command, machine
from dpsearch.runs import RunError
from scripts.arguments import at_least
from scripts.experiments import EXPERIMENTS
from scripts.experiments.experiment import Experiment, Illustration, Results
from scripts.experiments.jobs import Batch, Job, Outcome, RunLog, batches, run_all

ALL = "all"
RESULTS = Path("docs/results")


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the runs that are missing, and write what all of them come to."""
    arguments = sys.argv[1:] if arguments is None else arguments
    args = _parser().parse_args(arguments)
    for own in _own_commands(args.out) if args.name == ALL else [arguments]:
        _write(own)


def _own_commands(out: Path) -> Iterator[list[str]]:
    """For every table and figure, the arguments that made its page in the folder, or those that make a first one."""
    for name in EXPERIMENTS:
        page = out / f"{name}.json"
        if page.exists():
            _, _, *arguments = shlex.split(json.loads(page.read_text())["command"])  # python scripts/reproduce.py ...
        else:
            arguments = [name] if out == RESULTS else [name, "--out", str(out)]
        yield arguments


def _write(arguments: Sequence[str]) -> None:
    """Compute one table or figure, and write its page."""
    args = _parser().parse_args(arguments)
    how = command("scripts/reproduce.py", arguments)
    experiment = EXPERIMENTS[args.name]
    try:
        args.out.mkdir(parents=True, exist_ok=True)
        make = experiment.make if isinstance(experiment, Illustration) else partial(_resumable, experiment)
        page = make(args, how)
        page.write(args.out)
        print(page.markdown())
    except (OSError, RunError) as error:
        sys.exit(f"error: {error}")


def _resumable(experiment: Experiment, args: Namespace, how: str) -> Document:
    log = RunLog(args.out / f"{experiment.log or args.name}.runs.jsonl")
    try:
        return reproduce(experiment, args, log, how)
    except KeyboardInterrupt:
        print(f"interrupted; {log.path} has what is done, and the same command goes on", file=sys.stderr)
        sys.exit(130)
    except BrokenProcessPool:
        sys.exit(f"error: a process was killed, perhaps for want of memory; {log.path} has what is done")


def reproduce(experiment: Experiment, args: Namespace, log: RunLog, how: str) -> Document:
    """The page with the table, once all runs are made and the figure is drawn.

    Args:
        experiment: The table or figure.
        args: The options of the command line.
        log: The log of runs.
        how: The command line, in words.
    """
    cells = experiment.cells(args)
    runs = [min(args.fewer.get(cell.method.name, args.runs), args.runs) for cell in cells]
    jobs = [cell.jobs(experiment.run, range(args.seed, args.seed + n)) for cell, n in zip(cells, runs, strict=True)]
    found = make_runs([job for own in jobs for job in own], log, args.jobs, experiment.batch)
    outcomes = [[found[job] for job in own] for own in jobs]
    rows = [
        row
        for cell, own in zip(cells, outcomes, strict=True)
        for row in cell.rows(own, experiment.metrics, experiment.statistic)
    ]
    sections = experiment.sections(args, rows)
    results = Results(cells, outcomes, [row for section in sections for row in section.rows])
    table = experiment.table(
        name=experiment.name,
        title=experiment.title,
        text=experiment.text,
        command=how,
        versions=versions(),
        machine=machine(),
        words=experiment.words,
        statistic=experiment.statistic,
        sections=sections,
        **({} if experiment.extra is None else {"extra": experiment.extra(results)}),
    )
    experiment.draw(args, results, args.out / f"{experiment.name}.png")
    return table.document()


def make_runs(jobs: Sequence[Job], log: RunLog, processes: int, batch: int = 1) -> dict[Job, Outcome]:
    """The outcomes of all jobs; those that are not in the log are made now, in batches, and noted there."""
    outcomes = log.find(jobs)
    missing = batches((job for job in jobs if job not in outcomes), batch)
    terminal = sys.stderr.isatty()
    bar = tqdm(total=len(jobs), initial=len(outcomes), unit=" runs", mininterval=0.1 if terminal else 30.0)
    with bar:
        for done, results in run_all(missing, min(processes, max(len(missing), 1))):
            log.add(done, results)
            outcomes.update(zip(done, results, strict=True))
            bar.set_postfix_str(_words(done, results), refresh=False)
            bar.update(len(done))
    return outcomes


def _words(done: Batch, results: Sequence[Outcome]) -> str:
    solved = sum(result["solved"] for result in results)
    end = f"{solved} of {len(done)} solved" if len(done) > 1 else "solved" if solved else "failed"
    return f"{done[0].task}, {done[0].method}: {end}"


def _parser() -> ArgumentParser:
    parser = ArgumentParser(prog="reproduce.py", description=__doc__)
    names = parser.add_subparsers(dest="name", required=True, metavar="NAME")
    for name, experiment in EXPERIMENTS.items():
        own = names.add_parser(name, help=experiment.title, description=experiment.title)
        experiment.add_options(own)
        _add_out(own)
        own.add_argument(
            "--seed",
            type=at_least(0),
            default=experiment.seed if isinstance(experiment, Illustration) else 0,
            help="the first run's seed, and so on; default: %(default)s",
        )
        if isinstance(experiment, Illustration):
            continue
        own.add_argument(
            "--runs", type=at_least(1), default=experiment.runs, help="runs of each cell; default: %(default)s"
        )
        own.add_argument(
            "--fewer",
            type=_fewer,
            default=experiment.fewer,
            metavar="METHOD=K,..",
            help="fewer runs of some methods, such as those whose failing runs take long; default: "
            + (",".join(f"{method}={runs}" for method, runs in experiment.fewer.items()) or "none"),
        )
        own.add_argument("--jobs", type=at_least(1), default=os.cpu_count() or 1, help="processes; default: one a core")
    every = "Every table and figure, by the command that its page names"
    _add_out(names.add_parser(ALL, help=every, description=every))
    return parser


def _add_out(parser: ArgumentParser) -> None:
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder; default: %(default)s")


def _fewer(text: str) -> dict[str, int]:
    """Numbers of runs by method, ``elman=5,..``, as a type for argparse."""
    fewer = {}
    for part in text.split(","):
        method, _, runs = part.partition("=")
        fewer[method] = at_least(1)(runs)
    return fewer


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # kill ends it as Ctrl-C does
    main()
