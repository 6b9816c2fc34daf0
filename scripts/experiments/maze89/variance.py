"""What baselines do to the variance of the gradient in the 89-state maze (section 3.3.2)."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from dpsearch.algos import RPG
from dpsearch.algos.baselines.history import HistoryBaseline
from dpsearch.kernels.philox import stream_key
from dpsearch.report.figures import COLOURS, figure
from dpsearch.report.tables import Row, Section
from dpsearch.rollout import Episodes
from scripts.experiments.experiment import Cell, Experiment, Method, Results, no_options
from scripts.experiments.jobs import Outcome
from scripts.experiments.training import compose

BATCHES = 100  # of 50 episodes, whose gradients' variance is taken
PLAYED = 8  # purpose of the seed's stream that they are drawn from
CONSTANT, HISTORY, BOTH = "constant", "history", "history_by_constant"
WORDS = {
    CONSTANT: "constant baseline, by none",
    HISTORY: "history baseline, by none",
    BOTH: "history by constant",
}
STAGES = (2, 5, 10)  # million steps
SETTING = ("experiment=maze89_best",)


def measure(overrides: tuple[str, ...], seed: int) -> Outcome:
    """Learn for a while, then the variance of the gradient at the policy as it is then, with each baseline.

    The variance is the sum of the variances of all components, over batches that nothing has learned from.
    """
    settings = compose(overrides)
    algorithm = settings.algorithm(settings.rollouts(), seed)
    algorithm.learn(total_steps=settings.config.total_steps)
    assert isinstance(algorithm, RPG)
    assert isinstance(algorithm.baseline, HistoryBaseline)
    key, size = stream_key(seed, PLAYED), algorithm.config.batch_size
    batches = [
        algorithm.rollouts.collect(algorithm.policy, size, key=key, first_episode=size * k) for k in range(BATCHES)
    ]
    gamma = algorithm.config.gamma
    total = sum(float(batch.returns_to_go(gamma).sum()) for batch in batches)
    mean = total / sum(batch.steps for batch in batches)
    found: dict[str, list[NDArray[np.float32]]] = {"none": [], CONSTANT: [], HISTORY: []}
    for batch in batches:
        returns, mask = batch.returns_to_go(gamma), batch.mask
        for name, baseline in (("none", 0.0), (CONSTANT, mean), (HISTORY, algorithm.baseline.expected(batch))):
            found[name].append(_gradient(algorithm, batch, (returns - baseline) * mask))
    variance = {name: float(np.var(gradients, axis=0, ddof=1).sum()) for name, gradients in found.items()}
    return {
        "solved": 1,
        CONSTANT: variance[CONSTANT] / variance["none"],
        HISTORY: variance[HISTORY] / variance["none"],
        BOTH: variance[HISTORY] / variance[CONSTANT],
    }


def _gradient(algorithm: RPG, batch: Episodes, weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """The estimate of section 3.3.2 with given R_t - b ``(T, N)``, flat."""
    policy = algorithm.policy
    observations, actions = torch.from_numpy(batch.observations), torch.from_numpy(batch.actions)
    outputs = policy.distribution(policy.unroll(observations, actions, batch.lengths), actions)
    eligibilities, _ = policy.head.eligibilities(
        outputs.detach(), actions, torch.from_numpy(weights.astype(np.float32) / len(batch))
    )
    parts = torch.autograd.grad(outputs, policy.free_parameters(), eligibilities)
    return np.concatenate([part.numpy().ravel() for part in parts])


def _cells(args: Namespace) -> list[Cell]:
    cells = []
    for stage in STAGES:
        overrides = (*SETTING, f"total_steps={stage}_000_000")
        method = Method(f"after_{stage}", f"after {stage} million steps", overrides)
        cells.append(Cell("89-state maze", method, overrides, compose(overrides)))
    return cells


def _sections(args: Namespace, rows: list[Row]) -> list[Section]:
    return [Section("Variance of the gradient", [row for row in rows if row.metric in WORDS])]


def _draw(args: Namespace, results: Results, path: Path) -> None:
    with figure(path, [1], size=(7.0, 3.2)) as panels:
        axes = panels[0, 0]
        for k, name in enumerate((CONSTANT, HISTORY)):
            for place, outcomes in enumerate(results.outcomes):
                values = [outcome[name] for outcome in outcomes]
                axes.plot([place + 0.1 * k] * len(values), values, "o", color=COLOURS[k], alpha=0.6,
                          label=WORDS[name] if place == 0 else None)  # fmt: skip
        axes.set_xticks(range(len(results.cells)), [cell.method.label for cell in results.cells])
        axes.axhline(1.0, color="black", linewidth=0.8)
        axes.set_ylim(0.0)
        axes.set_ylabel("variance of the gradient")
        axes.legend(frameon=False)


MAZE89_VARIANCE = Experiment(
    name="maze89_variance",
    title="The 89-state maze: what baselines do to the variance of the gradient",
    text=(
        f"RPG in its best setting, after some steps of learning. Then {BATCHES} further batches "
        "of 50 episodes were played, and the gradient of each estimated with R_t alone, with R_t less the mean of all "
        "R_t, and with R_t less what the history baseline expected. Numbers are ratios of the variance, summed over "
        "all weights: mean over runs with the 95% bootstrap interval."
    ),
    runs=5,
    statistic="mean",
    metrics=tuple(WORDS),
    words=WORDS,
    run=measure,
    add_options=no_options,
    cells=_cells,
    sections=_sections,
    draw=_draw,
)
