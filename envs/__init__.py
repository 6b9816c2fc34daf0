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
    from dpsearch.envs.cheese_maze import CheeseMaze as CheeseMaze
    from dpsearch.envs.driving.track import Track as Track
    from dpsearch.envs.maze4x3 import Maze4x3 as Maze4x3
    from dpsearch.envs.maze89 import Maze89 as Maze89
    from dpsearch.envs.poles.env import DoublePole as DoublePole
    from dpsearch.envs.poles.env import DoublePoleHidden as DoublePoleHidden
    from dpsearch.envs.poles.env import SinglePole as SinglePole
    from dpsearch.envs.poles.env import SinglePoleHidden as SinglePoleHidden
    from dpsearch.envs.pomdp_file import POMDP as POMDP
    from dpsearch.envs.shuttle import ShuttleDocking as ShuttleDocking
    from dpsearch.envs.tiger import Tiger as Tiger
    from dpsearch.envs.tmaze import TMaze as TMaze
    from dpsearch.envs.torcs import TorcsError as TorcsError
    from dpsearch.envs.torcs.env import TORCS as TORCS

# Public name -> the module it comes from: the imports above, for the interpreter.
_HOMES = {
    "CheeseMaze": "dpsearch.envs.cheese_maze",
    "DoublePole": "dpsearch.envs.poles.env",
    "DoublePoleHidden": "dpsearch.envs.poles.env",
    "Maze4x3": "dpsearch.envs.maze4x3",
    "Maze89": "dpsearch.envs.maze89",
    "POMDP": "dpsearch.envs.pomdp_file",
    "ShuttleDocking": "dpsearch.envs.shuttle",
    "SinglePole": "dpsearch.envs.poles.env",
    "SinglePoleHidden": "dpsearch.envs.poles.env",
    "TMaze": "dpsearch.envs.tmaze",
    "TORCS": "dpsearch.envs.torcs.env",
    "Tiger": "dpsearch.envs.tiger",
    "TorcsError": "dpsearch.envs.torcs",
    "Track": "dpsearch.envs.driving.track",
}

__all__ = [
    "POMDP",
    "TORCS",
    "CheeseMaze",
    "DoublePole",
    "DoublePoleHidden",
    "Maze4x3",
    "Maze89",
    "ShuttleDocking",
    "SinglePole",
    "SinglePoleHidden",
    "TMaze",
    "Tiger",
    "TorcsError",
    "Track",
]


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value: object = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value  # found directly from now on
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))


def _register(name: str, home: str, reward_threshold: float | None = None, *, vector: bool = True) -> None:
    """Registers one environment, without a step limit: each knows its own, from its arguments."""
    if name not in gymnasium.registry:
        gymnasium.register(
            id=name,
            entry_point=home,
            vector_entry_point=f"{home}Vector" if vector else None,
            reward_threshold=reward_threshold,
        )


_register("dpsearch/TMaze-v0", "dpsearch.envs.tmaze:TMaze", reward_threshold=3.8)
_register("dpsearch/Tiger-v0", "dpsearch.envs.tiger:Tiger", reward_threshold=80.0)
_register("dpsearch/ShuttleDocking-v0", "dpsearch.envs.shuttle:ShuttleDocking", reward_threshold=1700.0)
_register("dpsearch/Maze4x3-v0", "dpsearch.envs.maze4x3:Maze4x3", reward_threshold=0.7)
_register("dpsearch/CheeseMaze-v0", "dpsearch.envs.cheese_maze:CheeseMaze", reward_threshold=0.9)
_register("dpsearch/Maze89-v0", "dpsearch.envs.maze89:Maze89", reward_threshold=0.95)
_register("dpsearch/POMDP-v0", "dpsearch.envs.pomdp_file:POMDP")  # what counts as solved is up to the file
for _name in ("SinglePole", "SinglePoleHidden", "DoublePole", "DoublePoleHidden"):
    _register(f"dpsearch/{_name}-v0", f"dpsearch.envs.poles.env:{_name}", reward_threshold=100_000.0)
_register("dpsearch/TORCS-v0", "dpsearch.envs.torcs.env:TORCS", vector=False)  # returns are up to track and speed
_register(
    "dpsearch/Track-v0", "dpsearch.envs.driving.track:Track"
)  # returns depend on the profile: none counts as solved
