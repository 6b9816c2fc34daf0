"""Black-box functions: table 4.1, figures 4.4 to 4.6, 5.1, 5.2 and 7.1 to 7.3, and all searches (``functions``).

Read ``tables.py`` first. ``methods.py`` has the searches, ``runs.py`` makes one run, and ``landscapes.py`` has table
4.1 and figure 4.4, which need no more than one quick run.
"""

from scripts.experiments.functions.tables import EXPERIMENTS as EXPERIMENTS

__all__ = ["EXPERIMENTS"]
