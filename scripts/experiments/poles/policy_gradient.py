"""Pole balancing by policy gradient: the methods of table 3.1, and how a run ends."""

from __future__ import annotations

from typing import Any

from dpsearch.algos.base import Algorithm, Metrics
from dpsearch.envs.poles.env import LONGEST
from dpsearch.kernels.philox import stream_key
from dpsearch.rollout import make_rollouts
from scripts.experiments.experiment import Method
from scripts.experiments.jobs import Outcome
from scripts.experiments.learning import CORE_SECONDS, ENV_STEPS, EVALUATIONS, UPDATES, learn
from scripts.experiments.training import compose

PROMISING = 500  # mean steps of a batch from which on the policy is put to the test
TESTS = 7  # purpose of the seed's stream that the tests draw from
SETTING = "experiment=poles_rpg"
SHORT = "total_episodes=10_000"  # for what may never succeed

SEEN, HIDDEN = ("single_pole", "double_pole"), ("single_pole_hidden", "double_pole_hidden")
CAREFUL = ("algo.damping=0.001", "algo.natural_step=0.01", "algo.restart_gain=0.05")
QUIET = ("policy.noise_memory=0", "policy.init_std=null")
OWN = {
    **dict.fromkeys(SEEN, ("policy.core=none", *CAREFUL)),
    "single_pole_hidden": (*CAREFUL, *QUIET, "algo.trace=0.98"),
    "double_pole_hidden": (),
}
MARKOV = Method("rpg_markov", "RPG without memory", ())
RPG = Method("rpg", "RPG, LSTM", ())
WHITE = Method("white", "RPG with independent noise", (SHORT, *QUIET))
FREE = Method("free", "RPG with little damping", (SHORT, "algo.damping=0.0001"))
ADAM = Method(
    "adam", "RPG with Adam instead",
    (SHORT, "algo.natural_step=null", "algo.optimizer=Adam", "algo.learning_rate=0.02",
     "algo.normalise_advantages=true"),
)  # fmt: skip
FAITHFUL = Method(
    "thesis", "RPG as in the thesis",
    (
        SHORT, "algo.natural_step=null", "algo.learning_rate=0.001", "algo.optimizer_options={momentum: 0.9}",
        "algo.batch_size=1", "algo.variance_scaled=true", "algo.baseline.kind=constant", "algo.trace=1.0",
        "env.gamma=0.99", "algo.restart_episodes=null", "policy.core=lstm", "policy.init_range=0.01", *QUIET,
    ),
)  # fmt: skip
METHODS = {method.name: method for method in (MARKOV, RPG, WHITE, FREE, ADAM, FAITHFUL)}
TRIED_ON = {  # methods that are not tried on all tasks
    MARKOV.name: SEEN,
    RPG.name: HIDDEN,
    WHITE.name: (*SEEN, "double_pole_hidden"),
    FREE.name: ("double_pole_hidden",),
}
FEWER = {WHITE.name: 5, FREE.name: 5, ADAM.name: 3, FAITHFUL.name: 1}  # runs of what may never succeed


def recipe(method: Method, env: str) -> tuple[str, ...]:
    """Our setting for a task, changed as the method says."""
    return (SETTING, *OWN[env], *method.overrides, f"env={env}")


def until_balanced(overrides: tuple[str, ...], seed: int) -> Outcome:
    """Learn until the mean actions balance for 100,000 steps.

    They are put to the test after every batch whose episodes last 500 steps on average; a test counts as an episode.
    """
    settings = compose(overrides)
    whole = make_rollouts(settings.config.env.id)  # to the task's own limit
    key = stream_key(seed, TESTS)
    tests, balanced = 0, False

    def test(learner: Algorithm[Any], metrics: Metrics) -> bool:
        nonlocal tests, balanced
        if metrics["episode_length"] >= PROMISING:
            played = whole.collect(learner.policy, 1, key=key, first_episode=tests, greedy=True, record=False)
            tests += 1
            balanced = bool(played.lengths[0] >= LONGEST)
        return not balanced

    run = learn(settings, seed, callback=test)
    return {
        "solved": int(balanced),
        EVALUATIONS: run.algorithm.episodes + tests,
        **run.counts(ENV_STEPS, UPDATES, CORE_SECONDS),
    }
