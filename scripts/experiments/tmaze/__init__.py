"""The T-maze: figure 3.4, and beyond it few steps (``tmaze_fast``) and long corridors (``tmaze_long``).

Read ``tables.py`` first. Runs are made by ``until_solved`` and ``until_goals`` in ``scripts/experiments/learning.py``.
"""

from scripts.experiments.tmaze.tables import EXPERIMENTS as EXPERIMENTS

__all__ = ["EXPERIMENTS"]
