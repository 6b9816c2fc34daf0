"""The baselines that RPG can have, by name."""

from __future__ import annotations

from dpsearch.algos.baselines.base import Baseline, ConstantBaseline, SharedBaseline
from dpsearch.algos.baselines.history import HistoryBaseline
from dpsearch.algos.baselines.quadratic import QuadraticBaseline
from dpsearch.algos.rpg.config import RPGConfig
from dpsearch.policies import RecurrentPolicy


def make_baseline(config: RPGConfig, policy: RecurrentPolicy, seed: int) -> Baseline:
    """The baseline that a configuration asks for.

    Args:
        config: Its ``baseline`` is one of ``BASELINES``.
        policy: Whose returns it is to expect.
        seed: Of the initial weights, for what has any.

    Raises:
        ValueError: If an optimiser does not take its options.
    """
    if config.baseline == "constant":
        return ConstantBaseline(config.baseline_episodes)
    if config.baseline == "shared":
        return SharedBaseline(policy.hidden_size, config.baseline_weight)
    if config.baseline == "quadratic":
        return QuadraticBaseline(policy.observation_size)
    try:
        return HistoryBaseline(
            policy.observation_size,
            policy.head,
            hidden_size=config.baseline_cells,
            optimizer=config.baseline_optimizer,
            learning_rate=config.baseline_learning_rate,
            optimizer_options=config.baseline_optimizer_options,
            steps=config.baseline_steps,
            seed=seed,
        )
    except ValueError as error:
        raise ValueError(f"baseline_{error}") from error
