"""The 89-state maze: section 3.4.3 and table 7.3; ablations of the best setting; the variance of its gradient."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from functools import partial

from dpsearch.report.tables import Row, Section
from scripts.arguments import add_choice
from scripts.experiments.experiment import Cell, Experiment, Method, no_options
from scripts.experiments.learning import CORE_SECONDS
from scripts.experiments.maze89 import reported, variance
from scripts.experiments.maze89.figures import draw_runs, draw_variance
from scripts.experiments.maze89.runs import AGENTS, ARRIVED, GOAL, MEDIAN, QUANTILE, ROLLOUTS, Yardstick, measure
from scripts.experiments.sampled_and_greedy import GREEDY, KINDS, SAMPLED, of_both
from scripts.experiments.training import compose

TASK = "89-state maze"
METRICS = {
    GOAL: "goal, %",
    MEDIAN: "median steps",
    ARRIVED: "median of those who arrive",
    QUANTILE: "90% quantile",
}

BEST = Method("rpg_best", "RPG, best setting", ("experiment=maze89_best",))
THESIS = Method(
    "rpg_thesis", "RPG, the thesis's two settings together, history baseline", ("experiment=maze89_thesis",)
)
CONSTANT_BASELINE = ("algo.baseline.kind=constant", "algo.baseline.episodes=1000")
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
        "algo.baseline.optimizer=SGD",
        "algo.baseline.optimizer_options={momentum: 0.9}",
        "algo.baseline.learning_rate=0.75",  # 0.001, times 10 episodes of 150 steps or so, over 2 for a square
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
        Method("shared", "with the shared baseline", (*SHORT, "algo.baseline.kind=shared")),
        Method(
            "constant",
            "with the constant baseline, and so a trace of 1",
            (*SHORT, "algo.baseline.kind=constant", "algo.baseline.episodes=1000", "algo.trace=1.0"),
        ),
        Method(
            "natural",
            "with the natural gradient instead of Adam",
            (*SHORT, "algo.optimizer=SGD", "algo.learning_rate=1.0", "algo.natural_step=0.003"),
        ),
        Method("ten_cells", "with 10 cells for the policy and 10 for the baseline",
               (*SHORT, "policy.hidden_size=10", "algo.baseline.cells=10")),
    )
}  # fmt: skip

IN_THESIS = {  # names of the thesis's numbers
    **dict.fromkeys((THESIS.name, TWENTY.name), "rpg"),
    **dict.fromkeys((CONSTANT.name, TWENTY_CONSTANT.name), "rpg_constant"),
    FEM.name: "fem",
    NES.name: "nes",
}
STAGES = (2, 5, 10)  # million steps, after which the variance of the gradient is taken


def with_agents(args: Namespace) -> list[Cell]:
    """The agents that do not learn, and each method."""
    agents = [Cell(TASK, Method(name, label), (name,), Yardstick(name)) for name, (label, _) in AGENTS.items()]
    return [*agents, *by_method(args)]


def by_method(args: Namespace) -> list[Cell]:
    """Each method."""
    return [_cell(method) for method in args.methods]


def _cell(method: Method) -> Cell:
    thesis = reported.thesis(IN_THESIS[method.name]) if method.name in IN_THESIS else {}
    return Cell(TASK, method, method.overrides, compose(method.overrides), thesis)


def by_stage(args: Namespace) -> list[Cell]:
    """The best setting, stopped at each stage."""
    stages = [
        Method(f"after_{stage}", f"after {stage} million steps", (*BEST.overrides, f"total_steps={stage}_000_000"))
        for stage in STAGES
    ]
    return [_cell(stage) for stage in stages]


def judged(args: Namespace, rows: list[Row]) -> list[Section]:
    """A section for sampled actions, one for the most likely ones, and one for the time."""
    by_kind = {kind: [row for row in rows if row.metric.startswith(kind)] for kind in KINDS}
    agents = {label for label, _ in AGENTS.values()}
    return [
        Section("As trained, with sampled actions", by_kind[SAMPLED]),
        Section("With the most likely actions", [row for row in by_kind[GREEDY] if row.method not in agents]),
        Section(
            "Core-seconds of a run", [row for row in rows if row.metric == CORE_SECONDS and row.method not in agents]
        ),
    ]


def judged_beside_others(args: Namespace, rows: list[Row]) -> list[Section]:
    """Sections as of ``judged``, with numbers that others report beside the sampled policies."""
    sampled, *rest = judged(args, rows)
    return [Section(sampled.heading, [*sampled.rows, *reported.others(TASK)]), *rest]


def of_variance(args: Namespace, rows: list[Row]) -> list[Section]:
    """A section of variances alone."""
    return [Section("Variance of the gradient", [row for row in rows if row.metric in variance.WORDS])]


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
    cells: Callable[[Namespace], list[Cell]],
    sections: Callable[[Namespace, list[Row]], list[Section]],
    fewer: dict[str, int],
) -> Experiment:
    return Experiment(
        name=name,
        title=title,
        text=f"{text} {WORDS}",
        runs=runs,
        statistic="mean",
        metrics=(*of_both(list(METRICS)), CORE_SECONDS),
        words={**{f"{kind}_{metric}": words for kind in KINDS for metric, words in METRICS.items()},
               CORE_SECONDS: "core-seconds"},
        run=measure,
        add_options=partial(add_choice, option="--methods", known=methods),
        cells=cells,
        sections=sections,
        draw=draw_runs,
        log="maze89",
        fewer=fewer,
    )  # fmt: skip


MAZE89_VARIANCE = Experiment(
    name="maze89_variance",
    title="The 89-state maze: what baselines do to the variance of the gradient",
    text=(
        f"RPG in its best setting, after some steps of learning. Then {variance.BATCHES} further batches "
        "of 50 episodes were played, and the gradient of each estimated with R_t alone, with R_t less the mean of all "
        "R_t, and with R_t less what the history baseline expected. Numbers are ratios of the variance, summed over "
        "all weights: mean over runs with the 95% bootstrap interval."
    ),
    runs=5,
    statistic="mean",
    metrics=tuple(variance.WORDS),
    words=variance.WORDS,
    run=variance.measure,
    add_options=no_options,
    cells=by_stage,
    sections=of_variance,
    draw=draw_variance,
)

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
        with_agents,
        judged_beside_others,
        fewer=dict.fromkeys(AGENTS, 1),
    ),
    _experiment(
        "maze89_ablations",
        "The 89-state maze: what each part of the best setting brings",
        "The best setting, stopped after 6 million steps, and the same with one part changed.",
        ABLATIONS,
        5,
        by_method,
        judged,
        fewer={},
    ),
    MAZE89_VARIANCE,
)
