"""The tables and figures of the thesis, and of what goes beyond it, by name."""

from scripts.experiments.experiment import Experiment
from scripts.experiments.tmaze import FIG_3_4, TMAZE_FAST, TMAZE_LONG

EXPERIMENTS: dict[str, Experiment] = {experiment.name: experiment for experiment in (FIG_3_4, TMAZE_FAST, TMAZE_LONG)}
