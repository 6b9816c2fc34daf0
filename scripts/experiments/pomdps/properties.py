"""Table 7.1: the finite POMDPs, counted."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import asdict, dataclass

import numpy as np

from dpsearch.envs.maze89 import Maze89
from dpsearch.files import versions
from dpsearch.pomdp.distributions import Distributions
from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.report.document import Document
from dpsearch.report.provenance import machine
from scripts.experiments.experiment import Illustration, no_options
from scripts.experiments.pomdps.reported import PROPERTIES
from scripts.experiments.pomdps.tasks import TASKS

SHOWN = ("shuttle", "cheese", "tiger", "tiger_single", "maze4x3", "tmaze7")
TEXT = (
    "Counted from the tables that the environments play. States include those of ended episodes: T-mazes have four, a "
    "tiger that ends the episode two. What is seen before the first action counts as an observation if it is never "
    "seen later: tigers show *nothing* then. There is noise where an action in a state, or arriving in a state by an "
    "action, can turn out in several ways; of the tiger's transitions it is the new choice of doors that is random. "
    "The thesis's numbers stand in brackets where they differ: it counts the goal's own observation in the cheese maze "
    "and the 89-state maze, which nobody gets to see, and 6 for the T-maze, where its text has 4."
)


@dataclass(frozen=True)
class Properties:
    """Counts of a finite POMDP.

    Attributes:
        states: Number of states, |S|.
        actions: Number of actions, |A|.
        observations: Number of observations, |O|.
        observation_noise: Whether a state can look different from time to time.
        transition_noise: Whether an action can have several outcomes.
    """

    states: int
    actions: int
    observations: int
    observation_noise: bool
    transition_noise: bool

    @classmethod
    def of(cls, pomdp: TabularPOMDP) -> Properties:
        """Count those of a model."""
        return cls(
            pomdp.n_states, pomdp.n_actions, pomdp.n_symbols, _several(pomdp.observations), _several(pomdp.transitions)
        )


def _several(distributions: Distributions) -> bool:
    return bool((np.diff(distributions.starts) > 1).any())


def table_7_1(args: Namespace, how: str) -> Document:
    """Compute the page."""
    head = ["task", "states", "actions", "observations", "noisy observations", "noisy transitions"]
    lines = [head, ["---", *["---:"] * 3, "---", "---"]]
    made = {TASKS[name].label: TASKS[name].task for name in SHOWN} | {"89-state maze": Maze89.make_task}
    found = {label: Properties.of(make().pomdp) for label, make in made.items()}
    for label, properties in found.items():
        ours = tuple(asdict(properties).values())
        theirs = PROPERTIES.get(label, ours)
        cells = (
            _word(value) + ("" if value == reported else f" ({_word(reported)})")
            for value, reported in zip(ours, theirs, strict=True)
        )
        lines.append([label, *cells])
    table = "\n".join("| " + " | ".join(line) + " |" for line in lines)
    return Document(
        name="table_7_1", title=TABLE_7_1.title, text=f"{TEXT}\n\n{table}",
        content={"rows": [{"task": label, **asdict(properties)} for label, properties in found.items()]},
        command=how, versions=versions(), machine=machine(),
    )  # fmt: skip


def _word(value: float | bool) -> str:
    return {True: "yes", False: "no"}[value] if isinstance(value, bool) else str(value)


TABLE_7_1 = Illustration("table_7_1", "Table 7.1: the finite POMDPs", no_options, table_7_1)
