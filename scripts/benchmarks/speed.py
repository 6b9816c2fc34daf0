"""Speed of playing episodes and of updating policies, in core-seconds of one thread.

The process's own CPU time is measured, so other work on the machine matters little; rivals take turns.
"""

from __future__ import annotations

import gc
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product
from time import process_time
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from dpsearch.algos import RPG
from dpsearch.envs.tmaze import EAST
from dpsearch.rollout import Episodes
from scripts.benchmarks.measurement import Measurement

TMAZE = "dpsearch.envs:dpsearch/TMaze-v0"
TRACK = "dpsearch.envs:dpsearch/Track-v0"
DRIVE = 1000  # steps of an episode at most
SAMPLE_SECONDS = 0.1  # least duration of one measurement of sampling
UPDATES = 20  # updates timed in each repetition
STANDING_STILL = 1e-12  # learning rate with which all updates are of the same policy


def sampling(repeats: int) -> list[Measurement]:
    """Environment steps a core-second, playing T-mazes with an LSTM of 10 cells."""
    cases = list(product(("random walk", "straight east"), (10, 100), (20, 100, 1000)))
    players = [walker(corridor, batch, straight=walk == "straight east") for walk, corridor, batch in cases]
    speeds = _play(players, repeats)
    return [
        Measurement.of(
            speed,
            benchmark="sampling",
            what=f"T-maze, N = {corridor}, batch {batch}, {walk}",
            unit="steps/core-second",
            at_least=5e6,
        )
        for (walk, corridor, batch), speed in zip(cases, speeds, strict=True)
    ]


def driving(repeats: int) -> list[Measurement]:
    """Environment steps a core-second: a car on the embedded track, and an LSTM of 10 cells that can't drive yet."""
    batches = (20, 100, 1000)
    players = [
        RPG(TRACK, batch_size=batch, learning_rate=STANDING_STILL, env_kwargs={"max_episode_steps": DRIVE})
        for batch in batches
    ]
    return [
        Measurement.of(
            speed,
            benchmark="driving",
            what=f"track, batch {batch}, up to {DRIVE:,} steps",
            unit="steps/core-second",
            at_least=3e6,
        )
        for batch, speed in zip(batches, _play(players, repeats), strict=True)
    ]


def _play(players: Sequence[RPG], repeats: int) -> list[list[float]]:
    """Steps a core-second that each one plays, in each repetition; they take turns."""
    for player in players:
        player.play_batch(player.config.batch_size)  # loads or compiles code at first use
    speeds: list[list[float]] = [[] for _ in players]
    for _ in _rounds(repeats):
        for player, speed in zip(players, speeds, strict=True):
            steps, seconds = 0, 0.0
            while seconds < SAMPLE_SECONDS:
                start = process_time()
                episodes = player.play_batch(player.config.batch_size)
                seconds += process_time() - start
                steps += episodes.steps
            speed.append(steps / seconds)
    return speeds


def update(repeats: int) -> list[Measurement]:
    """A whole RPG update, against the bare ``nn.LSTM`` forward and backward on the same tensors.

    They take turns at being the first, which is the slower: oneDNN prepares itself for each new length of a batch.
    """
    rows = []
    for corridor, straight in ((10, True), (100, True), (1000, True), (10, False)):
        algorithm = walker(corridor, 20, straight=straight)
        lstm = nn.LSTM(algorithm.policy.observation_size, algorithm.policy.hidden_size)
        algorithm.update()  # loads or compiles code at first use
        times: dict[str, list[float]] = {name: [] for name in ("whole", "sample", "gradient", "step", "bare")}
        for i in _rounds(repeats * UPDATES):
            observations = torch.from_numpy(next_batch(algorithm).observations)
            for name in ("bare", "whole") if i % 2 else ("whole", "bare"):
                start = process_time()
                if name == "whole":
                    metrics = algorithm.update()
                else:
                    _forward_backward(lstm, observations)
                times[name].append(process_time() - start)
            for phase in ("sample", "gradient", "step"):
                times[phase].append(metrics[f"time/{phase}"])
        walk = f"T = {corridor + 1}" if straight else f"random walk, N = {corridor}"
        rows += _update_rows(f"batch 20, {walk}", times)
    return rows


def _update_rows(case: str, times: dict[str, list[float]]) -> list[Measurement]:
    names = {
        "whole": ("RPG update", "core-ms"),
        "sample": ("of which sampling", "ms"),  # measured by RPG, which looks at the clock
        "gradient": ("of which gradient", "ms"),
        "step": ("of which step", "ms"),
        "bare": ("bare nn.LSTM", "core-ms"),
    }
    ratio = Measurement.of(
        np.divide(times["whole"], times["bare"]).tolist(),
        benchmark="update",
        what=f"RPG update / bare nn.LSTM, {case}",
        unit="",
        at_most=1.5,
    )
    return [
        *(
            Measurement.of(
                [1e3 * seconds for seconds in times[name]], benchmark="update", what=f"{words}, {case}", unit=unit
            )
            for name, (words, unit) in names.items()
        ),
        replace(ratio, median=float(np.median(times["whole"]) / np.median(times["bare"]))),  # not of the ratios
    ]


def walker(corridor: int, batch: int, *, straight: bool) -> RPG:
    """RPG on a T-maze, with a policy that does not change: a random walk, or east in every step."""
    env_kwargs: dict[str, Any] = {"corridor_length": corridor}
    if straight:
        env_kwargs["max_episode_steps"] = corridor + 1  # it never turns, so this ends the episode as a turn would
    algorithm = RPG(TMAZE, batch_size=batch, learning_rate=STANDING_STILL, env_kwargs=env_kwargs)
    if straight:
        with torch.no_grad():
            algorithm.policy.readout.bias[EAST] = 10.0
    return algorithm


def next_batch(algorithm: RPG) -> Episodes:
    """The episodes that the next update will play again."""
    return algorithm.rollouts.collect(
        algorithm.policy, algorithm.config.batch_size, key=algorithm.training_key, first_episode=algorithm.episodes
    )


def _forward_backward(lstm: nn.LSTM, observations: Tensor) -> None:
    lstm.zero_grad()
    features, _ = lstm(observations)
    features.backward(torch.ones_like(features))


def _rounds(number: int) -> Iterable[int]:
    """Repetitions on one thread, without the garbage collector."""
    torch.set_num_threads(1)
    gc.collect()
    gc.disable()
    try:
        yield from range(number)
    finally:
        gc.enable()
