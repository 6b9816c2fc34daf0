"""A run on disk: its directory, checkpoints and exact resume, metrics, TensorBoard, progress and summary."""

from dpsearch.errors import RunError
from dpsearch.rollout import EnvRecipe
from dpsearch.runs.directory import RunDirectory
from dpsearch.runs.limits import Limits
from dpsearch.runs.policy_file import load_policy, save_policy
from dpsearch.runs.run import Run

__all__ = ["EnvRecipe", "Limits", "Run", "RunDirectory", "RunError", "load_policy", "save_policy"]
