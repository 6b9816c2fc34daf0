"""Programs that the benchmarks run in processes of their own; each prints its numbers as JSON."""

from __future__ import annotations

import json
import resource
import sys
from collections.abc import Callable
from pathlib import Path
from time import perf_counter, process_time

TMAZE = "dpsearch.envs:dpsearch/TMaze-v0"


def first_update() -> dict[str, float]:
    """One RPG update of the default T-maze, imports and compilation included."""
    import torch

    from dpsearch.algos import RPG

    torch.set_num_threads(1)
    RPG(TMAZE).update()
    return {"core_seconds": process_time()}


def long_update() -> dict[str, float]:
    """One RPG update of 20 random walks in a corridor of 1000."""
    import torch

    from dpsearch.algos import RPG

    torch.set_num_threads(1)
    algorithm = RPG(TMAZE, env_kwargs={"corridor_length": 1000}, batch_size=20)
    imported = peak_memory()
    algorithm.update()
    return {"imported": imported, "peak": peak_memory()}


def longest_corridor() -> dict[str, float]:
    """Build a corridor of 100,000 and walk through it."""
    import gymnasium as gym

    from dpsearch.envs.tmaze import EAST

    start = perf_counter()
    env = gym.make(TMAZE, corridor_length=100_000)
    built = perf_counter()
    env.reset(seed=0)
    for _ in range(100_000):
        env.step(EAST)
    return {"build": built - start, "step": (perf_counter() - built) / 100_000, "peak": peak_memory()}


def peak_memory() -> float:
    """The most memory that this process has had, in MiB."""
    status = Path("/proc/self/status")
    if status.exists():  # Linux: getrusage would count what the parent had when it forked
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) / 1024
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 2**20 if sys.platform == "darwin" else peak / 1024


PROBES: dict[str, Callable[[], dict[str, float]]] = {
    probe.__name__: probe for probe in (first_update, long_update, longest_corridor)
}

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
    print(json.dumps(PROBES[sys.argv[1]]()))
