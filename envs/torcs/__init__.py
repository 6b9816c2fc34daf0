"""TORCS, The Open Racing Car Simulator, as an environment: the real one, run as a process of its own.

``python -m dpsearch.envs.torcs`` sets it up. Nothing of TORCS is part of this package; the robot in ``robot/``, through
which it is driven, is compiled against TORCS' headers and therefore under the GNU GPL.
"""

from dpsearch.envs.torcs.client import Simulator as Simulator
from dpsearch.envs.torcs.client import State as State
from dpsearch.envs.torcs.installation import Installation as Installation
from dpsearch.envs.torcs.installation import TorcsError as TorcsError
from dpsearch.envs.torcs.reference import best_lap as best_lap

__all__ = ["Installation", "Simulator", "State", "TorcsError", "best_lap"]
