"""Racing: section 3.4.4, in TORCS and on the embedded track.

Read ``tables.py`` first. ``runs.py`` makes a run that learns while it drives, ``search.py`` and ``pedals.py`` those of
black-box search, and ``log.py`` notes a drive and computes its metrics.
"""

from scripts.experiments.driving.tables import EXPERIMENTS as EXPERIMENTS

__all__ = ["EXPERIMENTS"]
