"""Environments that need memory, registered with Gymnasium on import.

``gymnasium.make("dpsearch.envs:dpsearch/TMaze-v0")`` works anywhere: what precedes the colon is imported.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

import gymnasium

if __name__ != "dpsearch.envs":  # imported under two names, every class would exist twice
    raise ImportError(f"this package is called dpsearch.envs: import that, not {__name__}")

if TYPE_CHECKING:
    from dpsearch.envs.belief import BeliefFilter as BeliefFilter
    from dpsearch.envs.kernel_env import KernelEnv as KernelEnv
    from dpsearch.envs.kernel_vector_env import KernelVectorEnv as KernelVectorEnv
    from dpsearch.envs.poles import DoublePole as DoublePole
    from dpsearch.envs.poles import DoublePoleHidden as DoublePoleHidden
    from dpsearch.envs.poles import SinglePole as SinglePole
    from dpsearch.envs.poles import SinglePoleHidden as SinglePoleHidden
    from dpsearch.envs.tabular import TabularPOMDP as TabularPOMDP
    from dpsearch.envs.tabular_env import TabularEnv as TabularEnv
    from dpsearch.envs.task import Task as Task
    from dpsearch.envs.tmaze import TMaze as TMaze
    from dpsearch.envs.wrappers import HiddenState as HiddenState
    from dpsearch.envs.wrappers import ObserveOnly as ObserveOnly
    from dpsearch.envs.wrappers import PreviousAction as PreviousAction
    from dpsearch.envs.wrappers import PreviousReward as PreviousReward

# Public name -> the module it comes from: the imports above, for the interpreter.
_HOMES = {
    "DoublePole": "dpsearch.envs.poles",
    "DoublePoleHidden": "dpsearch.envs.poles",
    "HiddenState": "dpsearch.envs.wrappers",
    "KernelEnv": "dpsearch.envs.kernel_env",
    "KernelVectorEnv": "dpsearch.envs.kernel_vector_env",
    "ObserveOnly": "dpsearch.envs.wrappers",
    "PreviousAction": "dpsearch.envs.wrappers",
    "PreviousReward": "dpsearch.envs.wrappers",
    "SinglePole": "dpsearch.envs.poles",
    "SinglePoleHidden": "dpsearch.envs.poles",
    "TMaze": "dpsearch.envs.tmaze",
    "BeliefFilter": "dpsearch.envs.belief",
    "TabularEnv": "dpsearch.envs.tabular_env",
    "TabularPOMDP": "dpsearch.envs.tabular",
    "Task": "dpsearch.envs.task",
}

__all__ = [
    "BeliefFilter",
    "DoublePole",
    "DoublePoleHidden",
    "HiddenState",
    "KernelEnv",
    "KernelVectorEnv",
    "ObserveOnly",
    "PreviousAction",
    "PreviousReward",
    "SinglePole",
    "SinglePoleHidden",
    "TMaze",
    "TabularEnv",
    "TabularPOMDP",
    "Task",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value: object = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value  # found directly from now on
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))


def _register(name: str, home: str, reward_threshold: float) -> None:
    """Registers one environment, without a step limit: each knows its own, from its arguments."""
    if name not in gymnasium.registry:
        gymnasium.register(
            id=name,
            entry_point=home,
            vector_entry_point=f"{home}Vector",
            reward_threshold=reward_threshold,
        )


_register("dpsearch/TMaze-v0", "dpsearch.envs.tmaze:TMaze", reward_threshold=3.8)
for _name in ("SinglePole", "SinglePoleHidden", "DoublePole", "DoublePoleHidden"):
    _register(f"dpsearch/{_name}-v0", f"dpsearch.envs.poles:{_name}", reward_threshold=100_000.0)
