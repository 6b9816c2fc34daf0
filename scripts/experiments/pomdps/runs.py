"""One run on a small POMDP, and how its policy is judged."""

from __future__ import annotations

from typing import Any

import numpy as np

from dpsearch.algos import Algorithm
from dpsearch.pomdp.solvers.returns import Metrics, discounted_sums, metrics
from scripts.experiments.jobs import Outcome
from scripts.experiments.learning import CORE_SECONDS, ENV_STEPS, EPISODES, learn
from scripts.experiments.pomdps.tasks import TASKS, yardsticks
from scripts.experiments.sampled_and_greedy import GREEDY, KINDS
from scripts.experiments.training import compose

CHUNK = 500  # episodes that judge a policy, kept in memory at a time
METRICS = {
    "thesis_metric": "Mean over episodes of the reward per step, as in the thesis",
    "reward_per_step": "Reward per step: rewards of all episodes over steps of all episodes",
    "episode_return": "Return of an episode",
    "discounted_return": "Discounted return",
}
SHARE, REACHED = "share", "reached"  # of the way from random to optimal, and whether it is enough


def learn_and_play(recipe: tuple[str, tuple[str, ...]], seed: int) -> Outcome:
    """Learn until the overrides' limit of episodes, then judge the policy, sampled and greedy.

    Args:
        recipe: The task's name, and Hydra's overrides.
        seed: Seed of the run.
    """
    name, overrides = recipe
    settings = compose(overrides)
    run = learn(settings, seed)
    outcome: Outcome = {"solved": 1, **run.counts(CORE_SECONDS, ENV_STEPS, EPISODES)}
    for kind in KINDS:
        played = judged(run.algorithm, settings.config.env.gamma, TASKS[name].rollouts, greedy=kind == GREEDY)
        share = yardsticks(name).share(played.discounted_return.value)
        outcome |= {f"{kind}_{metric}": getattr(played, metric).value for metric in METRICS}
        outcome |= {f"{kind}_{SHARE}": share, f"{kind}_{REACHED}": int(share >= TASKS[name].goal)}
    return outcome


def judged(algorithm: Algorithm[Any], gamma: float, episodes: int, *, greedy: bool) -> Metrics:
    """Metrics of the policy, sampled or greedy, over episodes that it has not learned from."""
    parts = []
    for first in range(0, episodes, CHUNK):
        played = algorithm.rollouts.collect(
            algorithm.policy, CHUNK, key=algorithm.evaluation_key, first_episode=first, greedy=greedy
        )
        parts.append((played.returns, discounted_sums(played.rewards, gamma), played.lengths))
    returns, discounted, lengths = (np.concatenate(column) for column in zip(*parts, strict=True))
    return metrics(returns, discounted, lengths)
