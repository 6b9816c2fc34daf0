"""Speed of playing populations of policies, and of the searches themselves."""

from __future__ import annotations

from time import process_time
from typing import Any

import numpy as np

from dpsearch.algos import XNESPolicySearch
from dpsearch.search import SEARCHES
from scripts.benchmarks.measurement import Measurement

HIDDEN = "dpsearch.envs:dpsearch/DoublePoleHidden-v0"
LONG = 20_000  # steps; nearly all candidates get so far
WARM_UP = 40  # generations before the clock runs
GENERATIONS = 20  # timed in each repetition


def population(repeats: int) -> list[Measurement]:
    """Environment steps a core-second: two poles without velocities, each lane with its own LSTM of two cells.

    The candidates are a policy that keeps the poles up, disturbed a little: so little that all last, or so much that
    lengths differ a hundredfold.
    """
    champion = XNESPolicySearch(HIDDEN, seed=0).learn(until_solved=True, total_episodes=5000)
    assert champion.solved
    best, rng = champion.policy.vector(), np.random.default_rng(0)
    rows = []
    for words, disturbance, limit in (("equal lengths", 0.001, LONG), ("very unequal lengths", 0.1, 5 * LONG)):
        rollouts = XNESPolicySearch(HIDDEN, max_episode_steps=limit).rollouts
        for n in (128, 16):
            least = 15e6 if n == 128 and words == "equal lengths" else 7.5e6
            speeds = []
            weights = best + disturbance * rng.standard_normal((n, len(best)))
            for _ in range(repeats + 1):
                start = process_time()
                _, lengths = rollouts.evaluate(
                    champion.policy, weights, key=0, episodes=np.zeros((n, 1), np.int64), greedy=True
                )
                speeds.append(lengths.sum() / (process_time() - start))
            what = f"two poles hidden, population {n}, {words} ({lengths.min():,} to {lengths.max():,})"
            rows.append(
                Measurement.of(speeds[1:], benchmark="population", what=what, unit="steps/core-second", at_least=least)
            )
    return rows


def search(repeats: int) -> list[Measurement]:
    """One generation of ask and tell, with a fitness that costs nothing."""
    rows: list[Measurement] = []
    limits: dict[int, float | None] = {15: None, 100: 10.0}  # milliseconds
    for dimension, options in ((15, {}), (100, {"population": 128})):
        for name in ("cmaes", "nes", "nes, exact gradient", "xnes", "snes", "fem"):
            if name == "fem" and options:
                continue  # one point at a time, whatever the dimension
            extra: dict[str, Any] = {"gradient": "exact"} if "exact" in name else {}
            own = SEARCHES[name.partition(",")[0]](np.ones(dimension), 1.0, seed=0, **options, **extra)
            times = []
            for generation in range(WARM_UP + repeats * GENERATIONS):
                start = process_time()
                points = own.ask()
                own.tell(points, -(points**2).sum(axis=1))
                if generation >= WARM_UP:
                    times.append(1e3 * (process_time() - start))
            if dimension == 15 and name == "cmaes":
                limits[15] = float(np.median(times))
            what = f"ask and tell, {name}, d = {dimension}, population {own.population}"
            promised = None if name == "cmaes" else limits[dimension]
            rows.append(Measurement.of(times, benchmark="search", what=what, unit="core-ms", at_most=promised))
    return rows
