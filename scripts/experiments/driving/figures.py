"""The figure and the film of racing: the time off the road while learning, and the last lap of one run."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.axes import Axes
from PIL import Image

from dpsearch.algos import Algorithm
from dpsearch.envs.driving.track import Track
from dpsearch.envs.torcs.env import TORCS
from dpsearch.report.figures import COLOURS, GREY, figure
from dpsearch.report.statistics import bootstrap_interval
from dpsearch.runs.playback import Gif
from scripts.experiments.driving.log import CURVE, Drive
from scripts.experiments.driving.runs import learned
from scripts.experiments.experiment import Cell, Results
from scripts.experiments.training import compose

FILM_HZ = 10.0
HALF_HOUR = "total_steps=54_000"


def draw_drives(args: Namespace, results: Results, path: Path) -> None:
    """Time off the road by the minute, of all runs; then the last lap of one more run of the first cell.

    Args:
        args: The command line, with the seed of the run.
        results: The outcomes of the runs.
        path: The file.
    """
    cell = results.cells[0]
    run, drive = learned((*cast(tuple[str, ...], cell.recipe), HALF_HOUR), args.seed)
    _film(run.algorithm, cell, path.with_suffix(".gif"))
    line, width = _road(cell.task)
    with figure(path, [1, 1], columns=2, size=(11.0, 7.2)) as panels:
        _while_learning(panels[0, 0], results)
        _from_above(panels[0, 1], drive, line, width)
        lap = _last_lap(drive)
        places = drive.distance[lap] / 1000.0
        for axes, values, words in (
            (panels[1, 0], drive.speed[lap], "speed, km/h"),
            (panels[1, 1], drive.position[lap], "from the middle, half widths"),
        ):
            axes.plot(places, values, ".", markersize=1.5, color=COLOURS[0])
            axes.set(xlabel="along the road, km", ylabel=words)
        panels[1, 0].set_ylim(bottom=0.0)
        panels[1, 1].set_ylim(-1.1, 1.1)
        for edge in (-1.0, 1.0):
            panels[1, 1].axhline(edge, color=GREY, linewidth=1.0)
        panels[1, 0].set_title(f"{cell.task}: the last lap within half an hour")


def _film(algorithm: Algorithm[Any], cell: Cell, path: Path) -> None:
    """The policy's most probable actions, from the 25th minute of the speed profile on: eight seconds."""
    settings = compose(cell.recipe)
    env = settings.config.env.recipe().make("rgb_array")
    gif = Gif(path, FILM_HZ)
    observation, _ = env.reset(seed=0, options={"driven_steps": 45_000, "distance": 200.0})
    memory = None
    for step in range(240):
        action, memory = algorithm.predict(observation, memory, deterministic=True)
        observation, _, terminated, truncated, _ = env.step(action)
        if step % 3 == 0:
            frame: Any = env.render()
            gif.add(np.asarray(Image.fromarray(frame).resize((480, 270), Image.Resampling.LANCZOS)))
        if terminated or truncated:
            break
    gif.close()
    env.close()


def _while_learning(axes: Axes, results: Results) -> None:
    cells = zip(results.cells, results.outcomes, strict=True)
    # Those that learned while driving
    drives = [(cell, outcomes) for cell, outcomes in cells if CURVE in outcomes[0]]
    methods = list(dict.fromkeys(cell.method.name for cell, _ in drives))
    simulators = list(dict.fromkeys(cell.task for cell, _ in drives))
    for cell, outcomes in drives:
        minutes = [outcome[CURVE][:30] for outcome in outcomes]
        means = np.mean(minutes, axis=0)
        x = np.arange(len(means)) + 0.5
        colour, line = COLOURS[methods.index(cell.method.name)], ("-", "--")[simulators.index(cell.task)]
        axes.plot(x, means, line, color=colour, linewidth=1.5, label=f"{cell.task}: {cell.method.label}")
        if len(minutes) > 1:
            bands = [bootstrap_interval([m[i] for m in minutes], "mean") for i in range(len(means))]
            low, high = np.array([band or (np.nan, np.nan) for band in bands]).T
            axes.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0.0)
    axes.set(xlabel="minutes of driving", ylabel="off the road, s a minute")
    axes.set_title("While learning")
    axes.set_ylim(0.0, 55.0 + 8.0 * len(drives))  # room for the legend
    axes.legend(fontsize=7, loc="upper left")


def _from_above(axes: Axes, drive: Drive, line: np.ndarray[Any, Any], width: float) -> None:
    """The road, and the middle of it shifted by how far the car was from it, in the last lap."""
    closed = np.vstack([line, line[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    directions = np.gradient(closed, axis=0)
    normals = np.column_stack([-directions[:, 1], directions[:, 0]]) / np.hypot(*directions.T)[:, None]
    for side in (-0.5, 0.5):
        axes.plot(*(closed + side * width * normals).T, color=GREY, linewidth=0.6)
    lap = _last_lap(drive)
    place = drive.distance[lap]
    x, y = (np.interp(place, along, closed[:, i]) for i in (0, 1))
    across = [np.interp(place, along, normals[:, i]) * 0.5 * width * drive.position[lap] for i in (0, 1)]
    points = axes.scatter(x + across[0], y + across[1], c=drive.position[lap], s=1.0, cmap="coolwarm", vmin=-1, vmax=1)
    axes.figure.colorbar(points, ax=axes, label="from the middle, half widths", shrink=0.8)
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_title("The same lap from above")


def _last_lap(drive: Drive) -> slice:
    """The last complete lap; the last two minutes if there is none."""
    ends = np.flatnonzero(np.diff(drive.lap_time, prepend=0.0))
    if not len(ends):
        return slice(max(len(drive.speed) - 3600, 0), len(drive.speed))
    return slice(max(ends[-1] - round(30.0 * drive.lap_time[ends[-1]]), 0), ends[-1])


def _road(task: str) -> tuple[np.ndarray[Any, Any], float]:
    """The middle line (m), ``(K, 2)``, and the road's width (m)."""
    if task.startswith("TORCS"):
        env = TORCS("g-track-2")
        env.reset(seed=0)
        assert env.simulator is not None
        road = env.simulator.road()
        env.close()
        return road[:, :2], float(road[:, 2].mean())
    task_known = Track.make_task("g-track-2", 15.0)
    return np.column_stack([task_known.shape.x, task_known.shape.y]), task_known.width
