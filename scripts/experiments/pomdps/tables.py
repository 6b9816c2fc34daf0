"""Small POMDPs, tables 6.1 and 7.2: the sampled and the greedy policy of each method, beside what needs no learning."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from operator import attrgetter

from dpsearch.report.cross_tables import Grid
from dpsearch.report.tables import SUCCESS_RATE, Row, Section
from scripts.arguments import add_choice
from scripts.experiments.experiment import Cell, Experiment, Method
from scripts.experiments.learning import CORE_SECONDS
from scripts.experiments.pomdps import reported
from scripts.experiments.pomdps.figures import draw_shares
from scripts.experiments.pomdps.properties import TABLE_7_1
from scripts.experiments.pomdps.runs import METRICS, REACHED, SHARE, learn_and_play
from scripts.experiments.pomdps.tasks import (
    ANYWHERE,
    BEHIND,
    CHEESE,
    GOAL,
    MORE_ROLLOUTS,
    ROLLOUTS,
    SHUTTLE,
    TASKS,
    TEXT,
    PomdpTask,
    yardsticks,
)
from scripts.experiments.sampled_and_greedy import KINDS, SAMPLED, of_both
from scripts.experiments.training import compose

RPG = Method("rpg", "RPG", ("experiment=pomdps_rpg",))
RPG_THESIS = Method("rpg_thesis", "RPG as in the thesis", ("experiment=pomdps_rpg_thesis",))
LRWR = Method("lrwr", "LRWR", ("experiment=pomdps_lrwr",))
LRWR_THESIS = Method("lrwr_thesis", "LRWR as in the thesis", ("algo=lrwr",))
LRWR_FARSIGHTED = Method(
    "lrwr_farsighted", "LRWR as in the thesis, discounting by 0.98", (*LRWR_THESIS.overrides, "algo.gamma=0.98")
)
FEM = Method("fem", "FEM", ("algo=fem",))
NES = Method("nes", "NES", ("algo=nes", "algo.patience=null"))
CMAES = Method("cmaes", "CMA-ES", ("algo=cmaes",))
METHODS = {method.name: method for method in (RPG, RPG_THESIS, LRWR, LRWR_THESIS, LRWR_FARSIGHTED, FEM, NES, CMAES)}
BATCHED = {  # the setting that holds the thesis's batch size
    LRWR_THESIS.name: "algo.batch_size",
    LRWR_FARSIGHTED.name: "algo.batch_size",
    FEM.name: "algo.window",
    NES.name: "algo.population",
    CMAES.name: "algo.population",
}
LONGER = ("algo.entropy_halflife=100", "algo.learning_rate_halflife=646")  # of RPG, for 1500 updates instead of 600
OWN = {  # settings for some tasks, by method and task
    **{(RPG.name, task.name): (*RPG.overrides, *LONGER) for task in TASKS.values() if task.batch > 30},
    (LRWR.name, SHUTTLE.name): (*LRWR.overrides, "policy.hidden_size=24"),  # with 10, one run in eight finds no memory
}
TRIED_ON = {LRWR_FARSIGHTED.name: (CHEESE, ANYWHERE)}  # methods that are not tried on all tasks


def add_options(parser: ArgumentParser, *, methods: Sequence[Method], tasks: Sequence[PomdpTask]) -> None:
    """Add the options that choose methods and tasks.

    Args:
        parser: The parser that gets them.
        methods: Methods run by default.
        tasks: Tasks run by default.
    """
    add_choice(parser, "--methods", METHODS, [method.name for method in methods])
    add_choice(parser, "--tasks", TASKS, [task.name for task in tasks])


def cell(method: Method, task: PomdpTask) -> Cell:
    """One method on one task."""
    batched = (f"{BATCHED[method.name]}={task.batch}",) if method.name in BATCHED else ()
    chosen = (f"env={task.env}", *task.overrides, f"total_episodes={task.episodes}", "total_steps=null")
    settings = OWN.get((method.name, task.name), method.overrides)
    overrides = (*settings, *chosen, *batched)
    thesis = reported.thesis(method.name.partition("_")[0], task.name)
    return Cell(task.label, method, (task.name, overrides), compose(overrides), thesis)


def cells(args: Namespace) -> list[Cell]:
    """Each method on each task."""
    return [
        cell(method, task)
        for method in args.methods
        for task in args.tasks
        if task in TRIED_ON.get(method.name, args.tasks)
    ]


def sections(args: Namespace, rows: list[Row]) -> list[Section]:
    """Share of the way to the optimum and each metric: the text's tasks, then those behind the thesis's numbers."""
    groups = (("", TEXT), (", in the tasks behind the thesis's numbers", BEHIND))
    chosen = [(words, [task for task in group if task in args.tasks]) for words, group in groups]
    return [section for words, tasks in chosen if tasks for section in _sections(args, rows, tasks, words)]


def _sections(args: Namespace, rows: list[Row], tasks: list[PomdpTask], words: str) -> list[Section]:
    labels = [task.label for task in tasks]
    order = [method.label for method in args.methods]
    by_metric: dict[str, list[Row]] = {}
    for row in rows:
        kind, _, metric = row.metric.partition("_")
        if kind in KINDS and row.task in labels:
            method = row.method if kind == SAMPLED else f"{row.method}, greedy"
            by_metric.setdefault(metric, []).append(replace(row, method=method, metric=metric))
    for own in by_metric.values():
        own.sort(key=lambda row: order.index(row.method.removesuffix(", greedy")))
    reached = [
        replace(row, metric=SUCCESS_RATE, std=None).with_successes(round(row.mean * row.runs))
        for row in by_metric[REACHED]
        if row.mean is not None and row.runs is not None
    ]
    exceptions = "".join(f", {task.goal:.0%} in {task.label.lower()}" for task in tasks if task.goal != GOAL)
    took = [row for row in rows if row.metric == CORE_SECONDS and row.task in labels]
    return [
        Section(
            f"Percent of the way from the random to the optimal policy, by discounted return{words}",
            [_in_percent(row) for row in by_metric[SHARE]],
        ),
        Section(f"Runs that went at least {GOAL:.0%} of the way{exceptions}{words}", reached),
        *(Section(f"{title}{words}", [*known(tasks, metric), *by_metric[metric]]) for metric, title in METRICS.items()),
        Section(f"Core-seconds of a run{words}", took),
    ]


def _in_percent(row: Row) -> Row:
    """A part, as the percentage it is, to two decimals."""
    numbers = ("mean", "std", "median", "ci_low", "ci_high")
    return replace(
        row, **{name: round(100.0 * getattr(row, name), 2) for name in numbers if getattr(row, name) is not None}
    )


def known(tasks: Sequence[PomdpTask], metric: str) -> list[Row]:
    """Numbers that need no learning, as rows of the table."""
    rows = []
    for kind in ("random", "hand", "optimal", "sighted"):
        for task in tasks:
            estimate = getattr(getattr(yardsticks(task.name), kind), metric)
            label = {"sighted": "optimal if it saw the state"}.get(kind, kind)
            rows.append(Row(task=task.label, method=label, network="", metric=metric, median=estimate.value))
    return rows


WORDS = (
    "Each run plays as many episodes as LRWR did in the thesis: 100 batches of 30, or of 75 in cheese mazes and T-mazes"
    f". Its policy is then judged in {ROLLOUTS:,} other episodes, once with sampled and once with its most likely "
    f"actions ({MORE_ROLLOUTS:,} in 4x3 mazes, where luck makes most of an episode's return). "
    "Numbers are mean ± standard deviation over runs, with the 95% bootstrap interval of the mean. "
    "In italics what needs no learning, computed from the tasks' tables: all actions equally often, written by hand, "
    "and optimal for the discounted return, for who sees what the agent sees and for who sees the state. Where the "
    "thesis's numbers fit another task than its text describes, both are here: a tiger that ends the "
    "episode, a 4x3 maze in which the agent may slip any way and `-` costs no more than any step, a cheese maze "
    "entered anywhere in which bumps cost nothing, and T-mazes in which either turn is paid. In cheese mazes the "
    "thesis discounts by 0.7; policies are judged by that in any case. LRWR, without more words, is with its "
    "improvements: an LSTM of 10 cells, in shuttle docking 24. "
    "Core-seconds in the 4x3 maze with slips any way are, but for LRWR, of a busy Intel Xeon, others of an AMD EPYC."
)


def _experiment(name: str, title: str, methods: Sequence[Method], tasks: Sequence[PomdpTask]) -> Experiment:
    return Experiment(
        name=name,
        title=title,
        text=WORDS,
        runs=25,
        statistic="mean",
        metrics=(*of_both((*METRICS, SHARE, REACHED)), CORE_SECONDS),
        words={metric: metric for metric in (SHARE, *METRICS, SUCCESS_RATE, CORE_SECONDS)},
        run=learn_and_play,
        add_options=partial(add_options, methods=methods, tasks=tasks),
        cells=cells,
        sections=sections,
        draw=draw_shares,
        table=partial(Grid, line=attrgetter("method"), column=attrgetter("task"), corner="policy"),
        log="pomdps",
    )


EXPERIMENTS = (
    TABLE_7_1,
    _experiment(
        "table_6_1",
        "Table 6.1: small POMDPs with LRWR",
        (LRWR, LRWR_THESIS, LRWR_FARSIGHTED),
        (*BEHIND, *TEXT),
    ),
    _experiment(
        "table_7_2",
        "Table 7.2: small POMDPs with all algorithms",
        (RPG, LRWR, LRWR_THESIS, FEM, NES, CMAES),
        (*TEXT, *BEHIND),
    ),
)
