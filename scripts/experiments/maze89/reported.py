"""Numbers that the thesis and others report on the 89-state maze."""

from __future__ import annotations

from dpsearch.report.tables import Row
from scripts.experiments.experiment import reported
from scripts.experiments.maze89.runs import ARRIVED, GOAL
from scripts.experiments.sampled_and_greedy import SAMPLED

# Percent of the episodes that reach the goal, and the median of the steps that these take
THESIS = {  # section 3.4.3 and table 7.3, by method and baseline
    "rpg": (95, 58),
    "rpg_constant": (85, 70),
    "fem": (72, 92),
    "nes": (67, 101),
}
OTHERS = {  # as table 7.3 quotes them
    "human (Littman et al. 1995)": (100, 29),
    "RL-LSTM (Bakker 2004)": (94, 61),
    "linear Q on beliefs, seeded": (84, 33),
    "SARSA(lambda), memoryless": (77, 73),
}
HUMAN_GOAL, HUMAN_MEDIAN = OTHERS["human (Littman et al. 1995)"]


def thesis(name: str) -> dict[str, float]:
    """The thesis's numbers under one of its names, by metric."""
    goal, median = THESIS[name]
    return {f"{SAMPLED}_{GOAL}": goal, f"{SAMPLED}_{ARRIVED}": median}


def others(task: str) -> list[Row]:
    """The numbers of others, as rows of the table."""
    return [
        reported(task, f"reported: {name}", f"{SAMPLED}_{metric}", value)
        for name, values in OTHERS.items()
        for metric, value in zip((GOAL, ARRIVED), values, strict=True)
    ]
