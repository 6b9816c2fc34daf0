"""The 89-state maze: section 3.4.3 and table 7.3, what each part of the best setting brings."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from contextlib import suppress
from functools import cache, partial
from hashlib import sha256
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpsearch.envs.maze89 import Maze89
from dpsearch.pomdp.solvers.agents import Agent, BeliefAgent, Controller, fully_observed
from dpsearch.pomdp.solvers.play import play
from dpsearch.pomdp.solvers.point_based import point_based
from dpsearch.pomdp.solvers.value_iteration import value_iteration
from dpsearch.pomdp.task import TabularTask, tabular_task
from dpsearch.report.tables import Row, Section
from scripts.arguments import named
from scripts.experiments.experiment import Cell, Experiment, Method
from scripts.experiments.jobs import Outcome
from scripts.experiments.maze89.figures import draw_runs
from scripts.experiments.pomdps.hand_written import HAND_WRITTEN
from scripts.experiments.training import compose

ROLLOUTS = 1_000  # that judge a policy
SAMPLED, GREEDY = "sampled", "greedy"
GOAL, MEDIAN, QUANTILE, ARRIVED = "goal", "median", "quantile_90", "median_arrived"
METRICS = {
    GOAL: "goal, %",
    MEDIAN: "median steps",
    ARRIVED: "median of those who arrive",
    QUANTILE: "90% quantile",
}
COUNTED = tuple(f"{kind}_{metric}" for kind in (SAMPLED, GREEDY) for metric in METRICS)
CORE_SECONDS = "core_seconds"
TASK = "89-state maze"

BEST = Method("rpg_best", "RPG, best setting", ("experiment=maze89_best",))
THESIS = Method(
    "rpg_thesis", "RPG, the thesis's two settings together, history baseline", ("experiment=maze89_thesis",)
)
CONSTANT_BASELINE = ("algo.baseline=constant", "algo.baseline_episodes=1000")
CONSTANT = Method(
    "rpg_constant",
    "RPG, the thesis's two settings together, constant baseline",
    (*THESIS.overrides, *CONSTANT_BASELINE),
)
TWENTY = Method(
    "rpg_twenty",
    "RPG, batches of 20, history baseline",
    (*THESIS.overrides, "algo.batch_size=20", "algo.learning_rate=1.0", "~algo.optimizer_options.momentum"),
)
TWENTY_ACTION = Method(
    "rpg_twenty_action",
    "RPG, batches of 20, history baseline, previous action seen",
    (*TWENTY.overrides, "policy.previous_action=true"),
)
TWENTY_CONSTANT = Method(
    "rpg_twenty_constant",
    "RPG, batches of 20, constant baseline",
    (*TWENTY.overrides, *CONSTANT_BASELINE),
)
STANDARD = Method(
    "rpg_standard",
    "RPG, steps of 0.001 after each episode, history baseline",
    (
        *THESIS.overrides,
        "algo.batch_size=10",
        "algo.learning_rate=0.01",
        "algo.gradient_length=null",
        "algo.baseline_optimizer=SGD",
        "algo.baseline_optimizer_options={momentum: 0.9}",
        "algo.baseline_learning_rate=0.75",  # 0.001, times 10 episodes of 150 steps or so, over 2 for a square
    ),
)
SEARCH = ("env=maze89", "algo.episodes_per_fitness=250", "total_steps=30_000_000", "until_solved=false")
NES = Method("nes", "NES", ("algo=nes", "algo.patience=null", *SEARCH))
FEM = Method("fem", "FEM", ("algo=fem", *SEARCH))
LEARNED = {
    method.name: method
    for method in (BEST, THESIS, CONSTANT, TWENTY, TWENTY_ACTION, TWENTY_CONSTANT, STANDARD, NES, FEM)
}

SHORT = (*BEST.overrides, "total_steps=6_000_000")
ABLATIONS = {
    method.name: method
    for method in (
        Method("best", "the best setting", SHORT),
        Method("no_action", "without the previous action", (*SHORT, "policy.previous_action=false")),
        Method("no_entropy", "without the entropy bonus", (*SHORT, "algo.entropy_bonus=0.0")),
        Method("no_trace", "with a trace of 1: R_t - b", (*SHORT, "algo.trace=1.0")),
        Method("shared", "with the shared baseline", (*SHORT, "algo.baseline=shared")),
        Method(
            "constant",
            "with the constant baseline, and so a trace of 1",
            (*SHORT, "algo.baseline=constant", "algo.baseline_episodes=1000", "algo.trace=1.0"),
        ),
        Method(
            "natural",
            "with the natural gradient instead of Adam",
            (*SHORT, "algo.optimizer=SGD", "algo.learning_rate=1.0", "algo.natural_step=0.003"),
        ),
        Method("ten_cells", "with 10 cells for the policy and 10 for the baseline",
               (*SHORT, "policy.hidden_size=10", "algo.baseline_cells=10")),
    )
}  # fmt: skip

# Section 3.4.3, table 7.3, and what it quotes: percent that reach the goal, and the median of their steps
THESIS_NUMBERS = {
    **dict.fromkeys((THESIS.name, TWENTY.name), (95, 58)),
    **dict.fromkeys((CONSTANT.name, TWENTY_CONSTANT.name), (85, 70)),
    FEM.name: (72, 92),
    NES.name: (67, 101),
}
REPORTED = {
    "human (Littman et al. 1995)": (100, 29),
    "RL-LSTM (Bakker 2004)": (94, 61),
    "linear Q on beliefs, seeded": (84, 33),
    "SARSA(lambda), memoryless": (77, 73),
}


class Yardstick:
    """What is achieved without learning: settings for a cell of the table.

    Args:
        name: Which, a key of ``AGENTS``.
    """

    network = ""

    def __init__(self, name: str) -> None:
        self._name = name

    def fingerprint(self) -> str:
        """Tells it from others."""
        return sha256(f"maze89 {self._name}".encode()).hexdigest()[:16]


def _random(task: TabularTask) -> Agent:
    return Controller.random(task.pomdp)


def _hand(task: TabularTask) -> Agent:
    return HAND_WRITTEN["maze89"](task.pomdp)


def _belief(task: TabularTask) -> BeliefAgent:
    return point_based(task.pomdp, rounds=10, beliefs=150, tolerance=1e-4).agent()


def _sighted(task: TabularTask) -> Agent:
    return value_iteration(task.pomdp).controller()


AGENTS = {
    "random": ("random actions", _random),
    "hand": ("written by hand: goes where the most likely state would", _hand),
    "belief": ("best use of the belief, the model known (point-based)", _belief),
    "sighted": ("best for who sees the state", _sighted),
}


def measure(recipe: tuple[str, ...], seed: int) -> Outcome:
    """Learn, or make the yardstick, and judge what comes out."""
    if recipe[0] in AGENTS:
        return _known(recipe[0], seed)
    settings = compose(recipe)
    algorithm = settings.algorithm(settings.rollouts(), seed)
    algorithm.evaluate(1)  # loads the compiled code, or compiles it: that is no part of learning
    start = process_time()
    with suppress(FloatingPointError):  # it diverged: the policy is what it is
        algorithm.learn(total_steps=settings.config.total_steps)
    outcome: Outcome = {
        "solved": 1,
        CORE_SECONDS: process_time() - start,
        "env_steps": algorithm.env_steps,
        "episodes": algorithm.episodes,
    }
    for kind in (SAMPLED, GREEDY):
        judged = algorithm.evaluate(ROLLOUTS, deterministic=kind == GREEDY)
        outcome |= _achieved(kind, judged.returns > 0.0, judged.lengths)
    return outcome


def _known(name: str, seed: int) -> Outcome:
    start, task = process_time(), Maze89.make_task()
    if name == "sighted":
        task = tabular_task(fully_observed(task.pomdp), task.max_episode_steps)
    played = play(task, AGENTS[name][1](task), 20 * ROLLOUTS, seed)
    found = _achieved(SAMPLED, played.terminated, played.lengths)
    return {"solved": 1, CORE_SECONDS: process_time() - start, **found, **{
        metric.replace(SAMPLED, GREEDY): value for metric, value in found.items()
    }}  # fmt: skip


def _achieved(kind: str, arrived: NDArray[np.bool_], lengths: NDArray[np.int64]) -> dict[str, float]:
    """What E episodes come to; one that fails counts as longer than all others."""
    steps = np.where(arrived, lengths, lengths.max() + 1)
    return {
        f"{kind}_{GOAL}": 100.0 * float(arrived.mean()),
        f"{kind}_{MEDIAN}": float(np.median(steps)),
        f"{kind}_{QUANTILE}": float(np.quantile(steps, 0.9)),
        f"{kind}_{ARRIVED}": float(np.median(lengths[arrived])) if arrived.any() else float(lengths.max() + 1),
    }


@cache
def _yardstick_cells() -> tuple[Cell, ...]:
    return tuple(Cell(TASK, Method(name, label), (name,), Yardstick(name)) for name, (label, _) in AGENTS.items())


def _add_options(parser: ArgumentParser, *, methods: dict[str, Method]) -> None:
    parser.add_argument(
        "--methods", type=named(methods), default=list(methods.values()), metavar="M,..",
        help=f"which; default: {','.join(methods)}",
    )  # fmt: skip


def _cell(method: Method) -> Cell:
    goal, median = THESIS_NUMBERS.get(method.name, (None, None))
    thesis = {} if goal is None or median is None else {f"{SAMPLED}_{GOAL}": goal, f"{SAMPLED}_{ARRIVED}": median}
    return Cell(TASK, method, method.overrides, compose(method.overrides), thesis)


def _table_cells(args: Namespace) -> list[Cell]:
    return [*_yardstick_cells(), *map(_cell, args.methods)]


def _ablation_cells(args: Namespace) -> list[Cell]:
    return [_cell(method) for method in args.methods]


def _sections(args: Namespace, rows: list[Row], *, reported: dict[str, tuple[int, int]]) -> list[Section]:
    theirs = [
        Row(task=TASK, method=f"reported: {name}", network="", metric=f"{SAMPLED}_{metric}").with_report(value, value)
        for name, values in reported.items()
        for metric, value in zip((GOAL, ARRIVED), values, strict=True)
    ]
    seconds = [row for row in rows if row.metric == CORE_SECONDS]
    by_kind = {kind: [row for row in rows if row.metric.startswith(kind)] for kind in (SAMPLED, GREEDY)}
    known = {label for label, _ in AGENTS.values()}
    return [
        Section("As trained, with sampled actions", [*by_kind[SAMPLED], *theirs]),
        Section("With the most likely actions", [row for row in by_kind[GREEDY] if row.method not in known]),
        Section("Core-seconds of a run", [row for row in seconds if row.method not in known]),
    ]


WORDS = (
    f"Each policy is judged in {ROLLOUTS:,} roll-outs of at most 251 steps; numbers are means over runs with the 95% "
    "bootstrap interval. *Median steps* and the 90% quantile count an episode that does not reach the goal as longer "
    "than any other; the thesis's medians are of those that do."
)


def _experiment(
    name: str,
    title: str,
    text: str,
    methods: dict[str, Method],
    runs: int,
    reported: dict[str, tuple[int, int]],
    **options: Any,
) -> Experiment:
    return Experiment(
        name=name,
        title=title,
        text=f"{text} {WORDS}",
        runs=runs,
        statistic="mean",
        metrics=(*COUNTED, CORE_SECONDS),
        words={**{f"{kind}_{m}": words for kind in (SAMPLED, GREEDY) for m, words in METRICS.items()},
               CORE_SECONDS: "core-seconds"},
        run=measure,
        add_options=partial(_add_options, methods=methods),
        sections=partial(_sections, reported=reported),
        draw=draw_runs,
        log="maze89",
        **options,
    )  # fmt: skip


def _all(names: Sequence[str]) -> dict[str, int]:
    return dict.fromkeys(names, 1)


EXPERIMENTS = (
    _experiment(
        "table_7_3",
        "Table 7.3 and section 3.4.3: the 89-state maze",
        "The thesis has two settings for the T-maze and names none for this maze: batches of 20 with the gradient "
        "normalised to length 0.3, and steps of 0.001 after each episode with a momentum of 0.9. *Batches of 20* are "
        "the first as it is. The second is taken ten episodes at a time, with ten times the step: the same to first "
        "order, and several times faster. *The two together* are normalised gradients with momentum, tuned: batches of "
        "60 and a step size of 0.05 for 1 were chosen by runs of seeds from 1000 on. NES and FEM judge a policy by 250 "
        "episodes. All learn for 30 million steps, the best setting for 20. What knows the model was played 20,000 "
        "times. Other work ran beside most of the runs, which costs them core-seconds.",
        LEARNED,
        20,
        REPORTED,
        cells=_table_cells,
        fewer=_all(list(AGENTS)),
    ),
    _experiment(
        "maze89_ablations",
        "The 89-state maze: what each part of the best setting brings",
        "The best setting, stopped after 6 million steps, and the same with one part changed.",
        ABLATIONS,
        5,
        {},
        cells=_ablation_cells,
    ),
)
