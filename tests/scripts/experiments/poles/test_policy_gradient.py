"""Table 3.1: pole balancing by policy gradient."""

from __future__ import annotations

from argparse import Namespace

import pytest

from scripts.experiments.experiment import Method
from scripts.experiments.poles.policy_gradient import MARKOV, METHODS, RPG, recipe, until_balanced
from scripts.experiments.poles.reported import THESIS
from scripts.experiments.poles.tables import TABLE_3_1


@pytest.mark.parametrize(
    ("method", "env"), [(MARKOV, "single_pole"), (MARKOV, "double_pole"), (RPG, "single_pole_hidden")]
)
def test_poles_are_balanced_in_fewer_episodes_than_the_thesis_had(method: Method, env: str) -> None:
    found = until_balanced((*recipe(method, env), f"total_episodes={THESIS['rpg'][env][0]}"), 0)
    assert found["solved"]
    assert found["evaluations"] < THESIS["rpg"][env][0]


def test_a_plain_gradient_as_in_the_thesis_does_not_get_there_in_as_many() -> None:
    found = until_balanced((*recipe(METHODS["thesis"], "single_pole"), "total_episodes=2000"), 0)
    assert not found["solved"]


def test_every_cell_has_settings_of_its_own_and_the_thesis_s_numbers() -> None:
    cells = TABLE_3_1.cells(Namespace(methods=list(METHODS.values())))
    assert len({cell.settings.fingerprint() for cell in cells}) == len(cells) == 16
    assert all(cell.thesis["success_rate"] == 1.0 for cell in cells)
