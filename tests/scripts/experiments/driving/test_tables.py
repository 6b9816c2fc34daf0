"""The table of section 3.4.4."""

from __future__ import annotations

from argparse import ArgumentParser

from scripts.experiments.driving.runs import measure, measure_until_failure
from scripts.experiments.driving.search import search_steering
from scripts.experiments.driving.tables import EXPERIMENTS


def test_runs_of_a_method_are_made_by_what_it_has_for_them() -> None:
    parser = ArgumentParser()
    (experiment,) = EXPERIMENTS
    experiment.add_options(parser)
    args = parser.parse_args(["--methods", "rpg,rpg_faster,search", "--simulators", "track"])
    jobs = [cell.jobs(experiment.run, [3, 4]) for cell in experiment.cells(args)]
    assert [[job.seed for job in own] for own in jobs] == [[3, 4]] * 3
    assert [own[0].work for own in jobs] == [measure, measure_until_failure, search_steering]
