"""Finite POMDPs: the model, its dynamics, beliefs about its hidden state, its file format, its solvers.

::

    distributions -> model -> kernel -> task -> env    the Gymnasium class of every finite task
                       |
                       +-> belief                      Bayes' rule for the hidden state
                       +-> file_format/                Cassandra's .POMDP files
                       +-> solvers/                    optima and bounds to compare a learned policy with
"""

from dpsearch.pomdp.belief import BeliefFilter
from dpsearch.pomdp.distributions import Distributions
from dpsearch.pomdp.env import TabularEnv
from dpsearch.pomdp.file_format.reader import read_pomdp_file
from dpsearch.pomdp.file_format.tokens import PomdpFileError
from dpsearch.pomdp.file_format.writer import write_pomdp_file
from dpsearch.pomdp.model import TabularPOMDP
from dpsearch.pomdp.task import TabularTask, tabular_task

__all__ = [
    "BeliefFilter",
    "Distributions",
    "PomdpFileError",
    "TabularEnv",
    "TabularPOMDP",
    "TabularTask",
    "read_pomdp_file",
    "tabular_task",
    "write_pomdp_file",
]
