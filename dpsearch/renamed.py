"""Settings that were renamed: an old name is refused, and the error says the new one."""

RENAMED = {
    "algo.baseline_episodes": "algo.baseline.episodes",
    "algo.baseline_weight": "algo.baseline.weight",
    "algo.baseline_cells": "algo.baseline.cells",
    "algo.baseline_optimizer": "algo.baseline.optimizer",
    "algo.baseline_learning_rate": "algo.baseline.learning_rate",
    "algo.baseline_optimizer_options": "algo.baseline.optimizer_options",
    "algo.baseline_steps": "algo.baseline.steps",
    "policy.core=rnn": "policy.core=elman",
}
"""New names by old ones. Where a value was renamed, both sides have it: ``"group.key=old": "group.key=new"``."""


def renaming(setting: str) -> str | None:
    """The words that tell a user of a new name; None for a setting that was not renamed.

    Args:
        setting: Full name, such as ``algo.baseline_cells``, with ``=`` and the value where that was renamed.
    """
    return f"{setting} is now {RENAMED[setting]}" if setting in RENAMED else None
