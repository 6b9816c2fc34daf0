"""The tables and figures of the thesis, and of what goes beyond it, by name."""

from scripts.experiments.driving.tables import EXPERIMENTS as DRIVING
from scripts.experiments.experiment import Experiment, Illustration
from scripts.experiments.functions.landscapes import FIG_4_4, TABLE_4_1
from scripts.experiments.functions.tables import EXPERIMENTS as FUNCTIONS
from scripts.experiments.maze89.tables import EXPERIMENTS as MAZE89
from scripts.experiments.maze89.variance import MAZE89_VARIANCE
from scripts.experiments.poles.policy_gradient import TABLE_3_1
from scripts.experiments.poles.tables import EXPERIMENTS as POLES
from scripts.experiments.pomdps.properties import TABLE_7_1
from scripts.experiments.pomdps.tables import EXPERIMENTS as POMDPS
from scripts.experiments.tmaze.tables import FIG_3_4, TMAZE_FAST, TMAZE_LONG

EXPERIMENTS: dict[str, Experiment | Illustration] = {
    experiment.name: experiment
    for experiment in (
        TABLE_3_1,
        FIG_3_4,
        TABLE_4_1,
        FIG_4_4,
        *FUNCTIONS,
        *POLES,
        TABLE_7_1,
        *POMDPS,
        *MAZE89,
        MAZE89_VARIANCE,
        *DRIVING,
        TMAZE_FAST,
        TMAZE_LONG,
    )
}
