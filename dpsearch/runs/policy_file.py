"""``policy.pt``: a policy's weights, its architecture and its environment: all that is needed to act."""

from __future__ import annotations

from dataclasses import asdict
from os import PathLike
from typing import Any

import gymnasium as gym

from dpsearch.algos import Algorithm
from dpsearch.files import CheckpointError, read_checkpoint, write_checkpoint
from dpsearch.policies import PolicyConfig, RecurrentPolicy
from dpsearch.rollout import EnvRecipe


def save_policy(path: str | PathLike[str], algorithm: Algorithm[Any], recipe: EnvRecipe) -> None:
    """Write an algorithm's policy."""
    write_checkpoint(
        path,
        {
            "architecture": algorithm.policy.config(),
            "deterministic": algorithm.deterministic_policy,
            "weights": algorithm.policy.state_dict(),
            "env": asdict(recipe),
        },
    )


def load_policy(path: str | PathLike[str]) -> tuple[RecurrentPolicy, EnvRecipe]:
    """A policy and the environment it was trained in.

    Raises:
        CheckpointError: If there is no such file, it is truncated or corrupt, or it is a run's checkpoint instead.
        RunError: If the environment cannot be made on this machine.
    """
    content = read_checkpoint(path)
    if not {"architecture", "deterministic", "weights", "env"} <= content.keys():
        raise CheckpointError(f"{path} is a checkpoint: give policy.pt or the run's directory")
    recipe = EnvRecipe(**content["env"])
    env: gym.Env[Any, Any] = recipe.make()
    policy = RecurrentPolicy.for_spaces(
        env.observation_space,
        env.action_space,
        PolicyConfig(**content["architecture"]),
        deterministic=content["deterministic"],
    )
    env.close()
    policy.load_state_dict(content["weights"])
    return policy, recipe
