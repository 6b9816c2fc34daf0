"""Building blocks of environments: a task with a kernel, the Gymnasium classes that play it, wrappers, drawing.

Start with ``task.py``. ``env.py`` is the scalar class, ``vector_env.py`` the vector class; both step the kernel
through ``stepper.py``, so they agree bit for bit. ``drawing/`` has the canvas that the tasks' pictures are painted on.
"""

from dpsearch.env_kit.env import KernelEnv
from dpsearch.env_kit.task import Task
from dpsearch.env_kit.vector_env import KernelVectorEnv, VectorOf
from dpsearch.env_kit.wrappers import HiddenState, ObserveOnly, PreviousAction, PreviousReward

__all__ = [
    "HiddenState",
    "KernelEnv",
    "KernelVectorEnv",
    "ObserveOnly",
    "PreviousAction",
    "PreviousReward",
    "Task",
    "VectorOf",
]
