"""Pole balancing: table 3.1 by policy gradient; tables 4.2, 5.1, 7.4 and one recurrent unit by black-box search."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from operator import attrgetter

from dpsearch.report.cross_tables import Grid
from dpsearch.report.statistics import Statistic
from dpsearch.report.tables import SUCCESS_RATE, Row, Section
from scripts.arguments import add_choice
from scripts.experiments.experiment import Cell, Experiment, Method
from scripts.experiments.learning import CORE_SECONDS, EVALUATIONS, until_solved
from scripts.experiments.poles import policy_gradient, reported
from scripts.experiments.poles.figures import draw_evaluations
from scripts.experiments.training import compose

TASKS = {
    "single_pole": "1 pole",
    "single_pole_hidden": "1 pole, no velocities",
    "double_pole": "2 poles",
    "double_pole_hidden": "2 poles, no velocities",
}
LIMIT = ("total_steps=20_000_000", "total_episodes=20_000")

NES_THESIS = Method("nes_thesis", "NES as in the thesis", ("experiment=poles_nes_thesis",))
FEM_THESIS = Method("fem_thesis", "FEM as in the thesis", ("experiment=poles_fem_thesis",))
NES = Method("nes", "NES, exact gradient", ("algo=nes", *LIMIT))
FEM = Method("fem", "FEM", ("algo=fem", *LIMIT))
XNES = Method("xnes", "xNES", ("algo=xnes", *LIMIT))
XNES_MIXING = Method("xnes_im", "xNES, importance mixing", ("algo=xnes", "algo.importance_mixing=true", *LIMIT))
SNES = Method("snes", "SNES", ("algo=snes", *LIMIT))
CMAES = Method("cmaes", "CMA-ES", ("algo=cmaes", *LIMIT))
ONE_UNIT = Method("one_unit", "xNES, importance mixing, population 20", ("experiment=poles_one_unit", *LIMIT))
METHODS = {
    method.name: method for method in (XNES, XNES_MIXING, SNES, CMAES, NES, FEM, NES_THESIS, FEM_THESIS, ONE_UNIT)
}


@dataclass(frozen=True)
class Network:
    """A policy's architecture.

    Attributes:
        label: Name in tables, with the number of weights for two poles without velocities.
        overrides: Hydra's overrides that choose the network.
    """

    label: str
    overrides: tuple[str, ...]


LSTM = Network("LSTM, 2 cells (42 weights)", ())
THREE = Network("Elman, 3 units (21)", ("policy.core=elman", "policy.hidden_size=3", "algo.sigma0=0.5"))
ONE = Network("1 unit (4)", ("policy.core=elman", "policy.hidden_size=1", "policy.readout=false"))


def cell(method: Method, env: str, network: Network, task: str) -> Cell:
    """One method on one task."""
    overrides = (*method.overrides, f"env={env}", *network.overrides)
    as_in_thesis = network is LSTM and method in (NES_THESIS, FEM_THESIS)
    thesis = reported.thesis(method.name.removesuffix("_thesis"), env) if as_in_thesis else {}
    return Cell(task, method, overrides, compose(overrides), thesis)


def by_task(args: Namespace) -> list[Cell]:
    """Each method on each task, with the LSTM."""
    return [cell(method, env, LSTM, label) for method in args.methods for env, label in TASKS.items()]


def by_network(args: Namespace) -> list[Cell]:
    """Each method with each network, on two poles without velocities."""
    return [
        cell(method, "double_pole_hidden", network, network.label)
        for method in args.methods
        for network in (LSTM, THREE, ONE)
        if network is not ONE or method not in (NES_THESIS, FEM_THESIS)
    ]


def one_unit(args: Namespace) -> list[Cell]:
    """Each method with one unit, on two poles without velocities."""
    return [cell(method, "double_pole_hidden", ONE, ONE.label) for method in args.methods]


def measured(args: Namespace, rows: list[Row]) -> list[Section]:
    """The rows as they are."""
    return [Section("Evaluations until success", rows)]


def with_reported(args: Namespace, rows: list[Row], *, numbers: dict[str, int], task: str) -> list[Section]:
    """The rows, and numbers that others report."""
    return [Section("Evaluations until success", [*rows, *reported.rows(numbers, task)])]


def by_policy_gradient(args: Namespace) -> list[Cell]:
    """Each method of table 3.1 on the tasks that it is tried on."""
    cells = []
    for method in args.methods:
        for env, task in TASKS.items():
            if env in policy_gradient.TRIED_ON.get(method.name, TASKS):
                overrides = policy_gradient.recipe(method, env)
                cells.append(Cell(task, method, overrides, compose(overrides), reported.thesis("rpg", env)))
    return cells


def episodes_and_time(args: Namespace, rows: list[Row]) -> list[Section]:
    """A section for the episodes, and one for the time."""
    return [
        Section("Episodes until success", [row for row in rows if row.metric != CORE_SECONDS]),
        Section("Core-seconds of a run that succeeds", [row for row in rows if row.metric == CORE_SECONDS]),
    ]


BY_METHOD = partial(Grid, line=attrgetter("method"), column=attrgetter("task"), corner="method")
NUMBERS = (
    "An evaluation is one episode of one candidate. Success is a candidate that keeps the poles up for 100,000 steps, "
    "and the numbers say which evaluation that was: {} with the 95% bootstrap interval, over the runs that succeeded; "
    "in brackets how many these are, unless all did. A run has failed after 20,000 evaluations or 20 million steps "
    "(thesis: 100,000 evaluations). All "
    "searches begin at the policy's initial weights, near 0, with a standard deviation of 1 (0.5 with 3 units), except "
    "those as in the thesis, which begin at N(0, I)."
)


def _experiment(
    name: str, title: str, remark: str, methods: Sequence[Method], statistic: Statistic = "mean", **options: object
) -> Experiment:
    words = "mean ± standard deviation," if statistic == "mean" else "the median"
    return Experiment(
        name=name,
        title=title,
        text=f"{remark}\n\n{NUMBERS.format(words)}",
        runs=200,
        statistic=statistic,
        metrics=(EVALUATIONS,),
        words={EVALUATIONS: "evaluations", SUCCESS_RATE: "solved"},
        run=until_solved,
        add_options=partial(add_choice, option="--methods", known=METHODS, default=[method.name for method in methods]),
        draw=draw_evaluations,
        table=BY_METHOD,
        log="poles",
        **options,  # type: ignore[arg-type]
    )


TABLE_3_1 = Experiment(
    name="table_3_1",
    title="Table 3.1: pole balancing with RPG",
    text=(
        "Episodes are cut off after 5,000 steps while learning. When those of a batch last 500 steps on average, the "
        "policy's mean actions are put to the test: success is to balance for 100,000 steps, and each test counts as "
        "an episode. Numbers are mean ± standard deviation, with the 95% bootstrap interval, over the runs that "
        "succeeded; in brackets how many these are, unless all did. Our settings take natural steps and begin again "
        "from other weights when 300 episodes have not raised the mean return by a twentieth, with two poles and no "
        "velocities by a tenth. Where the velocities are seen there is no memory, and noise that lasts; else an LSTM, "
        "with one pole with independent noise and a trace of 0.98 instead of 0.99. With two poles and no velocities "
        "steps are twice as large (0.02 nats), and damping is 0.03 instead of 0.001: chosen by about 16 starts each of "
        "a dozen settings, seeds from 2000 on, and then 20 runs, seeds from 3000 on. The other rows change that; "
        "*little damping* is 0.0001. Runs end after 100,000 episodes as in the thesis, those of the changed settings "
        "or with the thesis's after 10,000. *As in the thesis*: steps of 0.001 times "
        "the variance after each episode, momentum 0.9, the mean return of the last 100 episodes for a baseline."
    ),
    runs=200,
    statistic="mean",
    metrics=(EVALUATIONS, CORE_SECONDS),
    words={EVALUATIONS: "episodes", SUCCESS_RATE: "solved", CORE_SECONDS: "core-seconds"},
    run=policy_gradient.until_balanced,
    add_options=partial(add_choice, option="--methods", known=policy_gradient.METHODS),
    cells=by_policy_gradient,
    sections=episodes_and_time,
    draw=draw_evaluations,
    table=BY_METHOD,
    fewer=policy_gradient.FEWER,
)

EXPERIMENTS = (
    TABLE_3_1,
    _experiment(
        "table_4_2",
        "Table 4.2: pole balancing with NES",
        "The thesis does not say how the search distribution was represented; a regression with 630 points for 946 "
        "parameters, as its settings imply, does not give its numbers on two poles.",
        (NES_THESIS, NES, XNES, XNES_MIXING, SNES),
        cells=by_task,
        sections=measured,
    ),
    _experiment(
        "table_5_1",
        "Table 5.1: pole balancing with FEM",
        "FEM as in the thesis forgets the covariance as fast as the mean. Then it is an average of 20 samples in 42 "
        "dimensions, collapses, and part of the runs converge too early. Our default forgets it at 0.5 / d, and sees "
        "samples from the mean they were drawn around.",
        (FEM_THESIS, FEM),
        cells=by_task,
        sections=measured,
    ),
    _experiment(
        "table_7_4",
        "Table 7.4: two poles without velocities",
        "All searches with the thesis's network and two of the later literature. Reported numbers are means from the "
        "thesis and from Gomez, Schmidhuber and Miikkulainen (2008), each with a network of its own.",
        (XNES, XNES_MIXING, SNES, CMAES, NES, FEM, NES_THESIS, FEM_THESIS),
        cells=by_network,
        sections=partial(with_reported, numbers=reported.TWO_POLES, task=LSTM.label),
    ),
    _experiment(
        "poles_one_unit",
        "Two poles without velocities with one recurrent unit",
        "Medians, as reported by Wierstra et al. (2014) for the same four weights.",
        (ONE_UNIT, XNES, SNES, CMAES),
        statistic="median",
        cells=one_unit,
        sections=partial(with_reported, numbers=reported.ONE_UNIT, task=ONE.label),
    ),
)
