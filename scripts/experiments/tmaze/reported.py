"""Numbers that the thesis and others report on the T-maze.

The thesis's text (section 3.4.2) and the caption of its figure 3.4 say up to which corridor each method gets, not after
how many iterations. The peers' numbers are today's recurrent PPOs with an LSTM of 32 cells, one thread and their own
defaults, CleanRL's with 16 environments of 128 steps.
"""

from __future__ import annotations

from dataclasses import replace

from dpsearch.report.tables import SUCCESS_RATE, Row
from scripts.experiments.learning import CORE_SECONDS, ENV_STEPS

LONGEST = "longest_corridor_solved"  # a metric of the table, beside those of a run

Span = tuple[float, float | None]  # from, to; None for no success by then

THESIS_RATES = dict.fromkeys(range(10, 91), 1.0) | {100: 0.78}  # of 100 runs each
RELIABLE = 0.9  # rate of success from which a corridor counts as solved reliably
# Method, network, and the longest corridor that is solved reliably; the last two are from Bakker (2002)
THESIS_LONGEST = (
    ("RPG", "LSTM, 10 cells", 90),
    ("RL-LSTM", "LSTM", 50),
    ("Elman value iteration", "Elman", 10),
)
# Method, corridor, environment steps, core-seconds
PEERS: tuple[tuple[str, int, Span | None, Span | None], ...] = (
    ("CleanRL PPO-LSTM", 10, (105_000, 105_000), (40, 50)),
    ("CleanRL PPO-LSTM", 20, (195_000, 260_000), (76, 112)),
    ("CleanRL PPO-LSTM", 50, (170_000, 235_000), (69, 86)),
    ("sb3 RecurrentPPO", 10, (292_000, 292_000), (183, 183)),
    ("sb3 RecurrentPPO", 20, None, (350, None)),
    ("sb3 RecurrentPPO", 50, None, (350, None)),
    ("PufferLib", 10, (811_000, 811_000), (18, 18)),
    ("PufferLib", 20, (2_400_000, 2_400_000), (51, 51)),
    ("PufferLib", 50, (3_600_000, None), None),
)


def task(corridor: int) -> str:
    """The name of a T-maze in tables."""
    return f"T-maze, N = {corridor}"


def thesis(corridor: int) -> dict[str, float]:
    """The thesis's success rate of RPG in this corridor, if it names one."""
    return {SUCCESS_RATE: THESIS_RATES[corridor]} if corridor in THESIS_RATES else {}


def peers(corridors: list[int]) -> list[Row]:
    """The peers' steps and core-seconds in these corridors, as rows of the table."""
    rows = []
    for method, corridor, steps, seconds in PEERS:
        blank = Row(task=task(corridor), method=method, network="LSTM, 32 cells", metric="")
        for metric, span in ((ENV_STEPS, steps), (CORE_SECONDS, seconds)):
            if corridor in corridors and span is not None:
                rows.append(replace(blank, metric=metric).with_report(*span))
    return rows
