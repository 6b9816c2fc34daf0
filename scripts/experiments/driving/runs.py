"""One run of a car that learns to steer while it drives, and the metrics of its drive."""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Any

from dpsearch.algos import Algorithm
from dpsearch.envs.driving.rules import SpeedProfile
from dpsearch.envs.driving.track import Track
from dpsearch.rollout import make_rollouts
from scripts.experiments.driving.log import (
    CLEAN,
    CURVE,
    FAILS,
    FOR_GOOD,
    LAP,
    OFF,
    SETTLED,
    STEPS_A_MINUTE,
    UNSEEN,
    WALL,
    WITHIN,
    WORN_IN,
    Drive,
    Logbook,
)
from scripts.experiments.driving.pedals import WIDTH
from scripts.experiments.driving.search import driven
from scripts.experiments.jobs import Outcome
from scripts.experiments.learning import ENV_STEPS, Learned, learn
from scripts.experiments.training import compose

TWO_MINUTES = 120.0  # of driving (s)
ONWARDS = (70.0, 190.0, 3600.0)  # the speeds after the thesis's, rising as they did
ONWARDS_STEPS = 108_000

UNSEEN_ROADS = range(1, 21)  # seeds
UNSEEN_SPEED = 50.0  # km/h: their hairpins have a radius of 25 m


def measure(overrides: tuple[str, ...], seed: int) -> Outcome:
    """Learn during a drive, and measure it."""
    return outcome(overrides, *learned(overrides, seed))


def measure_until_failure(overrides: tuple[str, ...], seed: int) -> Outcome:
    """Learn during a drive that ends when the policy fails, and measure it."""

    def goes_on(rows: array[float]) -> bool:
        return not Drive(rows[-5 * max(STEPS_A_MINUTE, round(30.0 * WORN_IN)) :]).failed

    return outcome(overrides, *learned(overrides, seed, goes_on))


def measure_and_drive_on(overrides: tuple[str, ...], seed: int) -> Outcome:
    """Learn during a drive, then drive on with mean actions, ever faster; speeds and laps are those then."""
    run, drive = learned(overrides, seed)
    then = driven(run.algorithm.policy, compose(overrides), ONWARDS, ONWARDS_STEPS)
    first = outcome(overrides, run, drive)
    del first[CURVE]  # the curve of the half hour alone is drawn already
    return {
        **first,
        CLEAN: then.clean_speed,
        LAP: then.best_lap,
        FAILS: SpeedProfile(*ONWARDS).speed(then.lasted),
    }


def learned(
    overrides: tuple[str, ...], seed: int, goes_on: Callable[[array[float]], bool] | None = None
) -> tuple[Learned, Drive]:
    """Learn during a drive.

    Args:
        overrides: Hydra's overrides.
        seed: Seed of the run.
        goes_on: Says after an update whether the drive goes on, by the rows that ``Logbook`` noted; None to drive on
            until the limit.

    Returns:
        The run, whose engine is closed, and the drive.
    """
    settings = compose(overrides)
    recipe, rows = settings.config.env.recipe(), array("d")
    run = learn(
        settings,
        seed,
        rollouts=make_rollouts(lambda: Logbook(recipe.make(), rows)),
        callback=None if goes_on is None else lambda *_: goes_on(rows),
        warm_up=False,  # it would be noted as driven
    )
    run.algorithm.close()
    return run, Drive(rows)


def outcome(overrides: tuple[str, ...], run: Learned, drive: Drive) -> Outcome:
    """The metrics of a drive."""
    profile = compose(overrides).config.env.recipe().kwargs["speed_profile"]
    later = drive.off_seconds[2:]
    return {
        "solved": 1,
        SETTLED: drive.settled,
        WITHIN: 100.0 * (max(drive.settled, drive.last_off) <= TWO_MINUTES),
        FOR_GOOD: drive.last_off,
        OFF: sum(later) / max(len(later), 1),
        CLEAN: drive.clean_speed,
        LAP: drive.best_lap,
        FAILS: SpeedProfile(*profile).speed(len(drive.speed) / 30.0),
        UNSEEN: unseen(run.algorithm, overrides),
        WALL: run.wall_seconds,
        CURVE: drive.off_seconds,
        **run.counts(ENV_STEPS),
    }


def unseen(algorithm: Algorithm[Any], overrides: tuple[str, ...]) -> float:
    """Percentage of twenty random roads on which the policy's most probable actions keep the car for three minutes."""
    kwargs = compose(overrides).config.env.recipe().kwargs
    options = {name: kwargs[name] for name in ("observations", "lookahead", "control_hz")}
    kept = 0
    for road in UNSEEN_ROADS:
        road_kwargs = {**options, "track": road, "width": WIDTH, "speed_profile": UNSEEN_SPEED, "stuck_seconds": 0.01}
        rollouts = make_rollouts(Track, env_kwargs=road_kwargs, max_episode_steps=5400)
        kept += not rollouts.collect(algorithm.policy, 1, key=0, greedy=True, record=False).terminated[0]
        rollouts.close()
    return 100.0 * kept / len(UNSEEN_ROADS)
