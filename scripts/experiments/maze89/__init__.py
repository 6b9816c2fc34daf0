"""The 89-state maze: table 7.3, the ablations of its best setting, and the variance of the gradient.

Read ``tables.py`` first. ``runs.py`` makes one run and judges its policy; ``variance.py`` makes those in which the
variance of the gradient is measured.
"""

from scripts.experiments.maze89.tables import EXPERIMENTS as EXPERIMENTS

__all__ = ["EXPERIMENTS"]
