"""Speed of driving the real TORCS, in seconds that one waits for: it is a process of its own."""

from __future__ import annotations

from time import perf_counter

from dpsearch.envs.torcs import Installation, TorcsError
from dpsearch.envs.torcs.client import Simulator
from scripts.benchmarks.measurement import Measurement

STEPS = 5000  # of one measurement
SPEED = 15.0  # m/s


def torcs(repeats: int) -> list[Measurement]:
    """Control steps a second of one TORCS in lock-step, straight on; nothing where TORCS is not installed."""
    try:
        Installation.find()
    except TorcsError:
        return []
    simulator = Simulator("g-track-2")
    speeds = []
    for _ in range(repeats):
        simulator.put(0.0, SPEED)
        start = perf_counter()
        for _ in range(STEPS):
            simulator.hold(0.0, SPEED)
        speeds.append(STEPS / (perf_counter() - start))
    simulator.close()
    what = "TORCS, one instance in lock-step"
    return [Measurement.of(speeds, benchmark="torcs", what=what, unit="control steps/s", at_least=1e4)]
