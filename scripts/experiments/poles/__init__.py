"""Pole balancing: tables 3.1, 4.2, 5.1 and 7.4, and one recurrent unit (``poles_one_unit``).

Read ``tables.py`` first. ``policy_gradient.py`` has the methods and the run of table 3.1; the runs of all others are
made by ``until_solved`` in ``scripts/experiments/learning.py``.
"""

from scripts.experiments.poles.tables import EXPERIMENTS as EXPERIMENTS

__all__ = ["EXPERIMENTS"]
