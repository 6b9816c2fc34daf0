"""The T-maze of section 3.4.2: figure 3.4, and two settings that go beyond it (``tmaze_fast``, ``tmaze_long``)."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from dataclasses import replace
from functools import partial
from itertools import takewhile

from dpsearch.report.tables import SUCCESS_RATE, Row, Section
from scripts.arguments import add_choice, at_least, at_least_one
from scripts.experiments.experiment import Cell, Experiment, Method
from scripts.experiments.learning import CORE_SECONDS, ENV_STEPS, EPISODES, UPDATES, until_goals, until_solved
from scripts.experiments.tmaze.figures import draw_corridors, draw_long, draw_peers
from scripts.experiments.tmaze.reported import LONGEST, RELIABLE, THESIS_LONGEST, peers, task, thesis
from scripts.experiments.training import compose

LSTM = Method("lstm", "RPG", ("algo=rpg", "env=tmaze"))
ELMAN = Method("elman", "RPG, Elman network", ("algo=rpg", "env=tmaze", "policy.core=elman"))
GRU = Method("gru", "RPG, GRU", ("algo=rpg", "env=tmaze", "policy.core=gru"))
FAST = Method("tmaze_fast", "RPG, tmaze_fast", ("experiment=tmaze_fast",))
LONG = Method("tmaze_long", "RPG, tmaze_long", ("experiment=tmaze_long",))
METHODS = {method.name: method for method in (LSTM, ELMAN, GRU, FAST, LONG)}

WORDS = {
    LONGEST: "longest N solved reliably",
    SUCCESS_RATE: "solved",
    ENV_STEPS: "environment steps",
    EPISODES: "episodes",
    UPDATES: "updates",
    CORE_SECONDS: "core-seconds",
}
METRICS = (ENV_STEPS, EPISODES, UPDATES, CORE_SECONDS)


def add_options(
    parser: ArgumentParser, *, corridors: tuple[int, ...], methods: tuple[Method, ...], limit: int | None
) -> None:
    """Add the T-maze's own options.

    Args:
        parser: The parser that gets them.
        corridors: Default corridor lengths.
        methods: Methods run by default.
        limit: Default limit of a run, in environment steps; None leaves it to the configuration.
    """
    parser.add_argument(
        "--corridors", type=at_least_one, default=list(corridors), metavar="N,..",
        help=f"default: {','.join(map(str, corridors))}",
    )  # fmt: skip
    add_choice(parser, "--methods", METHODS, [method.name for method in methods])
    parser.add_argument(
        "--step-limit", type=at_least(1), default=limit, metavar="STEPS",
        help=f"steps after which a run has failed; default: {limit or 'the configuration says'}",
    )  # fmt: skip


def cells(args: Namespace) -> list[Cell]:
    """One cell for each method and corridor."""
    limit = [] if args.step_limit is None else [f"total_steps={args.step_limit}"]
    found = []
    for corridor in args.corridors:
        for method in args.methods:
            overrides = (*method.overrides, f"env.corridor_length={corridor}", *limit)
            reported = thesis(corridor) if method is LSTM else {}
            found.append(Cell(task(corridor), method, overrides, compose(overrides), reported))
    return found


def with_longest(args: Namespace, rows: list[Row]) -> list[Section]:
    """The rows, and the longest corridor that each method solves reliably, as it does all shorter ones."""
    longest = {}
    for method in args.methods:
        rates = [row for row in rows if row.method == method.label and row.metric == SUCCESS_RATE]
        solved = list(
            takewhile(lambda rate: (rate[1].mean or 0.0) >= RELIABLE, zip(args.corridors, rates, strict=True))
        )
        length = solved[-1][0] if solved else 0
        longest[method.label] = Row(
            task="T-maze",
            method=method.label,
            network=rates[0].network,
            metric=LONGEST,
            runs=rates[0].runs,
            mean=length,
            median=length,  # whichever the table shows
        )
    for label, network, reported in THESIS_LONGEST:
        row = Row(task="T-maze", method=label, network=network, metric=LONGEST)
        longest[label] = replace(longest.get(label, row), thesis=reported)
    return [Section("How far each method gets", list(longest.values())), Section("Each corridor", rows)]


def with_peers(args: Namespace, rows: list[Row]) -> list[Section]:
    """The rows, and what peers report."""
    return [Section("Measured", rows), Section("Reported", peers(args.corridors))]


UNTIL_SOLVED = (
    "The numbers count what it took until 100 evaluation episodes of the stochastic policy reached a mean return of "
    "3.8, over the runs that got there. Success rates have Wilson's 95% interval. A corridor counts as solved reliably "
    "if at least 90% of the runs solve it, and all shorter ones of the table. The *thesis* columns hold what section "
    "3.4.2 and the caption of figure 3.4 say, in part after Bakker (2002); they give no numbers of iterations."
)

FIG_3_4 = Experiment(
    name="fig_3_4",
    title="Figure 3.4: the T-maze with recurrent policy gradients",
    text=f"Mean ± standard deviation, with the 95% bootstrap interval of the mean. {UNTIL_SOLVED}",
    runs=100,
    statistic="mean",
    metrics=METRICS,
    words=WORDS,
    run=until_solved,
    add_options=partial(add_options, corridors=tuple(range(10, 101, 10)), methods=(LSTM, ELMAN, GRU), limit=20_000_000),
    cells=cells,
    sections=with_longest,
    draw=draw_corridors,
)

TMAZE_FAST = Experiment(
    name="tmaze_fast",
    title="The T-maze in few steps",
    text=(
        "Medians with their 95% bootstrap interval. The numbers count what it took until 95 of the last 100 training "
        "episodes ended at the goal, over the runs that got there. Those in italics are reported: today's recurrent "
        "PPOs until the same criterion, with an LSTM of 32 cells, their own defaults (CleanRL's: 16 "
        "environments of 128 steps) and one thread of a machine with AVX-512; > where it was not met by then."
    ),
    runs=10,
    statistic="median",
    metrics=METRICS,
    words=WORDS,
    run=until_goals,
    add_options=partial(add_options, corridors=(10, 50), methods=(FAST,), limit=None),
    cells=cells,
    sections=with_peers,
    draw=draw_peers,
)

TMAZE_LONG = Experiment(
    name="tmaze_long",
    title="The T-maze with long corridors",
    text=f"Medians with their 95% bootstrap interval. {UNTIL_SOLVED}",
    runs=10,
    statistic="median",
    metrics=METRICS,
    words=WORDS,
    run=until_solved,
    add_options=partial(add_options, corridors=(500, 1000), methods=(LONG,), limit=None),
    cells=cells,
    sections=with_longest,
    draw=draw_long,
)

EXPERIMENTS = (FIG_3_4, TMAZE_FAST, TMAZE_LONG)
