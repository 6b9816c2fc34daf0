"""The tables and figures of the thesis, and others that go beyond it, by name.

To add one, describe it as an ``Experiment`` in ``tables.py`` of its family and list it in ``EXPERIMENTS`` there;
``scripts/reproduce.py`` then offers it by its name. In every family ``tables.py`` says what is measured, ``figures.py``
draws it and ``reported.py`` has the numbers of others; ``__init__.py`` names the further files.
"""

from scripts.experiments import driving, functions, maze89, poles, pomdps, tmaze
from scripts.experiments.experiment import Experiment, Illustration

EXPERIMENTS: dict[str, Experiment | Illustration] = {
    experiment.name: experiment
    for family in (tmaze, poles, functions, pomdps, maze89, driving)
    for experiment in family.EXPERIMENTS
}
