"""Table 7.3 and the ablations in the 89-state maze."""

from __future__ import annotations

from argparse import Namespace

from scripts.experiments.maze89.tables import ABLATIONS, EXPERIMENTS, LEARNED


def test_every_method_has_settings_of_its_own() -> None:
    for experiment, methods in zip(EXPERIMENTS, (LEARNED, ABLATIONS), strict=False):
        cells = experiment.cells(Namespace(methods=list(methods.values())))
        assert len({cell.settings.fingerprint() for cell in cells}) == len(cells)
