from argparse import ArgumentParser

import pytest

from dpsearch.report.tables import SUCCESS_RATE
from scripts.arguments import add_choice
from scripts.experiments import EXPERIMENTS, driving, functions, maze89, poles, pomdps, tmaze
from scripts.experiments.experiment import Cell, Experiment, Method, reported
from scripts.experiments.jobs import Outcome

OUTCOMES: list[Outcome] = [{"solved": 1, "evaluations": 100 + 20 * k} for k in range(4)] + [{"solved": 0}]


class Described:
    network = "LSTM, 2 cells"

    def fingerprint(self) -> str:
        return "abc"


def cell(thesis: dict[str, float]) -> Cell:
    return Cell("two poles", Method("nes", "NES"), ("algo=nes",), Described(), thesis)


def test_a_cell_has_its_success_rate_and_each_metric_over_the_runs_that_succeeded() -> None:
    rate, evaluations = cell({}).rows(OUTCOMES, ["evaluations"], "mean")
    assert (rate.metric, rate.runs, rate.solved, rate.mean) == (SUCCESS_RATE, 5, 4, 0.8)
    assert (evaluations.runs, evaluations.solved, evaluations.mean) == (5, 4, 130.0)
    assert (evaluations.method, evaluations.network, evaluations.thesis) == ("NES", "LSTM, 2 cells", None)


def test_a_deviation_that_the_thesis_reports_has_a_row_beside_ours() -> None:
    thesis = {"evaluations": 1304.0, "evaluations_std": 801.0, SUCCESS_RATE: 0.76}
    found = {row.metric: row for row in cell(thesis).rows(OUTCOMES, ["evaluations"], "mean")}
    assert {metric: row.thesis for metric, row in found.items()} == thesis
    assert found["evaluations_std"].mean == pytest.approx(25.8, rel=0.01)


def test_a_reported_number_has_no_runs() -> None:
    row = reported("two poles", "reported: ESP", "evaluations", 7374)
    assert (row.runs, row.median, row.network) == (None, 7374, "")


def test_every_experiment_of_every_family_has_a_name_of_its_own() -> None:
    families = (tmaze, poles, functions, pomdps, maze89, driving)
    assert len(EXPERIMENTS) == sum(len(family.EXPERIMENTS) for family in families)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_the_cells_of_an_experiment_differ_in_what_the_log_of_runs_calls_them(name: str) -> None:
    experiment, parser = EXPERIMENTS[name], ArgumentParser()
    experiment.add_options(parser)
    if isinstance(experiment, Experiment):
        keys = [
            str(job.key) for cell in experiment.cells(parser.parse_args([])) for job in cell.jobs(experiment.run, [0])
        ]
        assert len(set(keys)) == len(keys) > 0


def test_an_option_takes_names_and_gives_their_values() -> None:
    parser = ArgumentParser()
    add_choice(parser, "--methods", {"a": 1, "b": 2, "c": 3}, ["b"])
    add_choice(parser, "--tasks", {"x": 10, "y": 20})
    assert vars(parser.parse_args([])) == {"methods": [2], "tasks": [10, 20]}
    assert parser.parse_args(["--methods", "c,a,c"]).methods == [3, 1]
