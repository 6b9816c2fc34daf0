"""Small POMDPs, tables 6.1 and 7.2: the sampled and the greedy policy of each method, beside what needs no learning."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from time import process_time
from typing import Any

import numpy as np

from dpsearch.algos import Algorithm
from dpsearch.pomdp.solvers.returns import Metrics, discounted_sums, metrics
from dpsearch.report.cross_tables import Grid
from dpsearch.report.tables import SUCCESS_RATE, Row, Section
from scripts.arguments import named
from scripts.experiments.experiment import Cell, Experiment, Method
from scripts.experiments.jobs import Outcome
from scripts.experiments.pomdps.figures import draw_shares
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
from scripts.experiments.training import compose

CHUNK = 500  # episodes that judge a policy, kept in memory at a time
SAMPLED, GREEDY = "sampled", "greedy"
METRICS = {
    "thesis_metric": "Mean over episodes of the reward per step, as in the thesis",
    "reward_per_step": "Reward per step: rewards of all episodes over steps of all episodes",
    "episode_return": "Return of an episode",
    "discounted_return": "Discounted return",
}
SHARE, REACHED, CORE_SECONDS = "share", "reached", "core_seconds"
COUNTED = [f"{kind}_{metric}" for kind in (SAMPLED, GREEDY) for metric in (*METRICS, SHARE, REACHED)]

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
BATCHED = {  # the setting that the thesis's batch size is of
    LRWR_THESIS.name: "algo.batch_size",
    LRWR_FARSIGHTED.name: "algo.batch_size",
    FEM.name: "algo.window",
    NES.name: "algo.population",
    CMAES.name: "algo.population",
}
LONGER = ("algo.entropy_halflife=100", "algo.learning_rate_halflife=646")  # of RPG, for 1500 updates instead of 600
OWN = {  # what some tasks need, by method and task
    **{(RPG.name, task.name): (*RPG.overrides, *LONGER) for task in TASKS.values() if task.batch > 30},
    (LRWR.name, SHUTTLE.name): (*LRWR.overrides, "policy.hidden_size=24"),  # with 10, one run in eight finds no memory
}
TRIED_ON = {LRWR_FARSIGHTED.name: (CHEESE, ANYWHERE)}  # if not on all

# Table 7.2, and table 6.1 for the greedy policies of LRWR
THESIS: dict[str, dict[str, float]] = {
    "tiger_single": {"rpg": 0.67, "lrwr": -6.5, "fem": -13.4, "nes": -15.6},
    "shuttle": {"rpg": 1.31, "lrwr": 0.709, "fem": 0.34, "nes": 0.45},
    "maze4x3_any_way": {"rpg": 0.27, "lrwr": 0.240, "fem": 0.246, "nes": 0.21},
    "cheese_anywhere": {"rpg": 0.257, "lrwr": 0.177, "fem": 0.112, "nes": 0.10},
    "tmaze3_either": {"rpg": 1.0, "lrwr": 0.917, "fem": 1.0, "nes": 0.98},
    "tmaze5_either": {"rpg": 0.667, "lrwr": 0.615, "fem": 0.667, "nes": 0.64},
    "tmaze7_either": {"rpg": 0.5, "lrwr": 0.463, "fem": 0.485, "nes": 0.455},
}
THESIS_GREEDY = {
    "tiger_single": -5.7,
    "shuttle": 0.0,
    "maze4x3_any_way": 0.246,
    "cheese_anywhere": 0.212,
    "tmaze3_either": 1.0,
    "tmaze5_either": 0.662,
    "tmaze7_either": 0.484,
}


def learn_and_play(recipe: tuple[str, tuple[str, ...]], seed: int) -> Outcome:
    """Learn for as many episodes as LRWR has in 100 EM steps, then judge the policy, sampled and greedy.

    Args:
        recipe: The task's name, and Hydra's overrides.
        seed: Of the run.
    """
    name, overrides = recipe
    settings = compose(overrides)
    algorithm = settings.algorithm(settings.rollouts(), seed)
    algorithm.evaluate(1)  # loads the compiled code, or compiles it: that is no part of learning
    start = process_time()
    with suppress(FloatingPointError):  # it diverged: the policy is what it is
        algorithm.learn(total_episodes=TASKS[name].episodes)
    outcome: Outcome = {
        "solved": 1,
        CORE_SECONDS: process_time() - start,
        "env_steps": algorithm.env_steps,
        "episodes": algorithm.episodes,
    }
    for kind in (SAMPLED, GREEDY):
        played = judged(algorithm, settings.config.env.gamma, TASKS[name].rollouts, greedy=kind == GREEDY)
        share = yardsticks(name).share(played.discounted_return.value)
        outcome |= {f"{kind}_{metric}": getattr(played, metric).value for metric in METRICS}
        outcome |= {f"{kind}_{SHARE}": share, f"{kind}_{REACHED}": int(share >= TASKS[name].goal)}
    return outcome


def judged(algorithm: Algorithm[Any], gamma: float, episodes: int, *, greedy: bool) -> Metrics:
    """What the policy achieves in episodes that it has not learned from."""
    parts = []
    for first in range(0, episodes, CHUNK):
        played = algorithm.rollouts.collect(
            algorithm.policy, CHUNK, key=algorithm.evaluation_key, first_episode=first, greedy=greedy
        )
        parts.append((played.returns, discounted_sums(played.rewards, gamma), played.lengths))
    returns, discounted, lengths = (np.concatenate(column) for column in zip(*parts, strict=True))
    return metrics(returns, discounted, lengths)


def add_options(parser: ArgumentParser, *, methods: Sequence[Method], tasks: Sequence[PomdpTask]) -> None:
    """Add the options that choose methods and tasks.

    Args:
        parser: To this parser.
        methods: Those run by default.
        tasks: Likewise.
    """
    for option, known, default in (("methods", METHODS, methods), ("tasks", TASKS, tasks)):
        names = ",".join(each.name for each in default)
        parser.add_argument(
            f"--{option}", type=named(known), default=list(default), metavar="A,..", help=f"which; default: {names}"
        )


def cell(method: Method, task: PomdpTask) -> Cell:
    """One method on one task."""
    batched = (f"{BATCHED[method.name]}={task.batch}",) if method.name in BATCHED else ()
    chosen = (f"env={task.env}", *task.overrides, f"total_episodes={task.episodes}", "total_steps=null")
    settings = OWN.get((method.name, task.name), method.overrides)
    overrides = (*settings, *chosen, *batched)
    family, theirs = method.name.partition("_")[0], THESIS.get(task.name, {})
    thesis = {f"{SAMPLED}_thesis_metric": theirs[family]} if family in theirs else {}
    if family == "lrwr" and task.name in THESIS_GREEDY:
        thesis[f"{GREEDY}_thesis_metric"] = THESIS_GREEDY[task.name]
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
    """How far towards the optimum, and each metric, for the text's tasks and for those behind the thesis's numbers."""
    groups = (("", TEXT), (", in the tasks behind the thesis's numbers", BEHIND))
    chosen = [(words, [task for task in group if task in args.tasks]) for words, group in groups]
    return [section for words, tasks in chosen if tasks for section in _sections(args, rows, tasks, words)]


def _sections(args: Namespace, rows: list[Row], tasks: list[PomdpTask], words: str) -> list[Section]:
    labels = [task.label for task in tasks]
    order = [method.label for method in args.methods]
    by_metric: dict[str, list[Row]] = {}
    for row in rows:
        kind, _, metric = row.metric.partition("_")
        if kind in (SAMPLED, GREEDY) and row.task in labels:
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
    """What is achieved without learning."""
    rows = []
    for kind in ("random", "hand", "optimal", "sighted"):
        for task in tasks:
            estimate = getattr(getattr(yardsticks(task.name), kind), metric)
            label = {"sighted": "optimal if it saw the state"}.get(kind, kind)
            rows.append(Row(task=task.label, method=label, network="", metric=metric, median=estimate.value))
    return rows


def _method(row: Row) -> str:
    return row.method


def _task(row: Row) -> str:
    return row.task


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
        metrics=(*COUNTED, CORE_SECONDS),
        words={metric: metric for metric in (SHARE, *METRICS, SUCCESS_RATE, CORE_SECONDS)},
        run=learn_and_play,
        add_options=partial(add_options, methods=methods, tasks=tasks),
        cells=cells,
        sections=sections,
        draw=draw_shares,
        table=partial(Grid, line=_method, column=_task, corner="policy"),
        log="pomdps",
    )


EXPERIMENTS = (
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
