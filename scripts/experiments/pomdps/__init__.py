"""Small POMDPs: tables 6.1, 7.1 and 7.2.

Read ``tables.py`` first, then ``tasks.py``. ``runs.py`` makes one run and judges its policy, ``hand_written.py`` has
the policies written by hand, and ``properties.py`` counts the states for table 7.1.
"""

from scripts.experiments.pomdps.tables import EXPERIMENTS as EXPERIMENTS

__all__ = ["EXPERIMENTS"]
