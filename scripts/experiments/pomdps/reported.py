"""Numbers that the thesis reports on small POMDPs: rewards per step (tables 6.1 and 7.2) and properties (table 7.1)."""

from __future__ import annotations

from scripts.experiments.sampled_and_greedy import GREEDY, SAMPLED

PROPERTIES = {  # table 7.1: states, actions, observations, noise in observations and in actions
    "Shuttle docking": (8, 3, 5, True, True),
    "Cheese maze": (11, 4, 7, False, False),
    "Tiger": (2, 3, 2, True, False),
    "4x3 maze": (11, 4, 6, False, True),
    "T-maze 7": (18, 4, 6, False, False),
    "89-state maze": (89, 5, 17, True, True),
}
# By task and algorithm: table 7.2
REWARDS: dict[str, dict[str, float]] = {
    "tiger_single": {"rpg": 0.67, "lrwr": -6.5, "fem": -13.4, "nes": -15.6},
    "shuttle": {"rpg": 1.31, "lrwr": 0.709, "fem": 0.34, "nes": 0.45},
    "maze4x3_any_way": {"rpg": 0.27, "lrwr": 0.240, "fem": 0.246, "nes": 0.21},
    "cheese_anywhere": {"rpg": 0.257, "lrwr": 0.177, "fem": 0.112, "nes": 0.10},
    "tmaze3_either": {"rpg": 1.0, "lrwr": 0.917, "fem": 1.0, "nes": 0.98},
    "tmaze5_either": {"rpg": 0.667, "lrwr": 0.615, "fem": 0.667, "nes": 0.64},
    "tmaze7_either": {"rpg": 0.5, "lrwr": 0.463, "fem": 0.485, "nes": 0.455},
}
# Of LRWR's greedy policies: table 6.1
GREEDY_REWARDS = {
    "tiger_single": -5.7,
    "shuttle": 0.0,
    "maze4x3_any_way": 0.246,
    "cheese_anywhere": 0.212,
    "tmaze3_either": 1.0,
    "tmaze5_either": 0.662,
    "tmaze7_either": 0.484,
}


def thesis(method: str, task: str) -> dict[str, float]:
    """The thesis's numbers of an algorithm, ``rpg``, ``lrwr``, ``fem`` or ``nes``, on a task; empty if it has none."""
    numbers = {}
    if method in REWARDS.get(task, {}):
        numbers[f"{SAMPLED}_thesis_metric"] = REWARDS[task][method]
    if method == "lrwr" and task in GREEDY_REWARDS:
        numbers[f"{GREEDY}_thesis_metric"] = GREEDY_REWARDS[task]
    return numbers
