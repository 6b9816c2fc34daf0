"""Pole balancing by black-box search: tables 4.2, 5.1 and 7.4, and one recurrent unit."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from dpsearch.report.cross_tables import Grid
from dpsearch.report.statistics import Statistic
from dpsearch.report.tables import SUCCESS_RATE, Row, Section
from scripts.arguments import named
from scripts.experiments.experiment import Cell, Experiment, Method
from scripts.experiments.poles.figures import draw_evaluations
from scripts.experiments.training import compose, until_solved

EVALUATIONS = "evaluations"
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
        label: For tables, with its number of weights where velocities are hidden and there are two poles.
        overrides: Hydra's overrides that choose it.
    """

    label: str
    overrides: tuple[str, ...]


LSTM = Network("LSTM, 2 cells (42 weights)", ())
THREE = Network("Elman, 3 units (21)", ("policy.core=elman", "policy.hidden_size=3", "algo.sigma0=0.5"))
ONE = Network("1 unit (4)", ("policy.core=elman", "policy.hidden_size=1", "policy.readout=false"))

# Means and standard deviations of tables 4.2 and 5.1, and the runs of 200 that succeeded
THESIS = {
    NES_THESIS.name: {
        "single_pole": (232, 65, 200),
        "single_pole_hidden": (538, 134, 200),
        "double_pole": (1150, 426, 200),
        "double_pole_hidden": (1443, 521, 200),
    },
    FEM_THESIS.name: {
        "single_pole": (103, 37, 200),
        "single_pole_hidden": (235, 48, 200),
        "double_pole": (1203, 632, 164),
        "double_pole_hidden": (1304, 801, 152),
    },
}
# Table 7.4, and for CMA-ES and RPG the thesis's own chapter 3 and Gomez et al. (2008)
REPORTED = {"SANE": 262_700, "ESP": 7374, "RPG": 6139, "CMA-ES": 3521, "CoSyNE": 1249}
# Wierstra et al. (2014), medians of 100 runs
REPORTED_ONE_UNIT = {"CoSyNE": 410, "xNES": 215, "SNES": 200, "xNES, mixing, adaptation": 170}


def add_options(parser: ArgumentParser, *, methods: Sequence[Method]) -> None:
    """Add the option that chooses methods.

    Args:
        parser: To this parser.
        methods: Those run by default.
    """
    default = ",".join(method.name for method in methods)
    parser.add_argument(
        "--methods", type=named(METHODS), default=list(methods), metavar="M,..",
        help=f"of {', '.join(METHODS)}; default: {default}",
    )  # fmt: skip


def cell(method: Method, env: str, network: Network, task: str) -> Cell:
    """One method on one task."""
    overrides = (*method.overrides, f"env={env}", *network.overrides)
    thesis = {}
    if network is LSTM and method.name in THESIS:
        mean, std, solved = THESIS[method.name][env]
        thesis = {EVALUATIONS: mean, f"{EVALUATIONS}_std": std, SUCCESS_RATE: solved / 200}
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


def with_reported(args: Namespace, rows: list[Row], *, reported: dict[str, int], task: str) -> list[Section]:
    """The rows, and what others report."""
    theirs = [
        Row(task=task, method=f"reported: {name}", network="", metric=EVALUATIONS).with_report(value, value)
        for name, value in reported.items()
    ]
    return [Section("Evaluations until success", [*rows, *theirs])]


def _method(row: Row) -> str:
    return row.method


def _task(row: Row) -> str:
    return row.task


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
        add_options=partial(add_options, methods=methods),
        draw=draw_evaluations,
        table=partial(Grid, line=_method, column=_task, corner="method"),
        log="poles",
        **options,  # type: ignore[arg-type]
    )


EXPERIMENTS = (
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
        sections=partial(with_reported, reported=REPORTED, task=LSTM.label),
    ),
    _experiment(
        "poles_one_unit",
        "Two poles without velocities with one recurrent unit",
        "Medians, as reported by Wierstra et al. (2014) for the same four weights.",
        (ONE_UNIT, XNES, SNES, CMAES),
        statistic="median",
        cells=one_unit,
        sections=partial(with_reported, reported=REPORTED_ONE_UNIT, task=ONE.label),
    ),
)
