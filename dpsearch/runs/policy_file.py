"""``policy.pt``: a policy's weights, its architecture and its environment: all that is needed to act."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from os import PathLike
from typing import Any

import numpy as np
from gymnasium import Space, spaces

from dpsearch.algos import Algorithm
from dpsearch.algos.memory import check_weights
from dpsearch.algos.stored import UNFITTING
from dpsearch.files import CheckpointError, read_checkpoint, write_checkpoint
from dpsearch.policies import PolicyConfig, RecurrentPolicy
from dpsearch.rollout import EnvRecipe

PARTS = {"architecture", "deterministic", "observation_size", "actions", "weights", "env"}


def save_policy(path: str | PathLike[str], algorithm: Algorithm[Any], recipe: EnvRecipe) -> None:
    """Write an algorithm's policy."""
    write_checkpoint(
        path,
        {
            "architecture": algorithm.policy.config(),
            "deterministic": algorithm.deterministic_policy,
            "observation_size": algorithm.policy.observation_size,
            "actions": _sizes(algorithm.rollouts.action_space),
            "weights": algorithm.policy.state_dict(),
            "env": asdict(recipe),
        },
    )


def load_policy(path: str | PathLike[str]) -> tuple[RecurrentPolicy, EnvRecipe]:
    """A policy and the environment it was trained in, which is not made: nothing is imported or executed for it.

    Raises:
        CheckpointError: If there is no such file, it is damaged, it is a run's checkpoint instead, or what is in it
            does not belong together.
    """
    content = read_checkpoint(path)
    if "algo" in content:
        raise CheckpointError(f"{path} is a checkpoint: give policy.pt or the run's directory")
    if not content.keys() >= PARTS:
        raise CheckpointError(f"{path} holds no policy: {', '.join(sorted(PARTS - content.keys()))} is missing")
    try:
        numbers = sum(weights.numel() for weights in content["weights"].values())
        if max(content["observation_size"], np.sum(content["actions"])) > numbers:
            raise ValueError("there are fewer weights than observations or actions")
        make = partial(
            RecurrentPolicy.for_spaces,
            spaces.Box(-1.0, 1.0, (content["observation_size"],)),
            _space(content["actions"]),
            PolicyConfig(**content["architecture"]),
            deterministic=content["deterministic"],
        )
        check_weights(make)
        policy = make()
        policy.load_state_dict(content["weights"])
        return policy, EnvRecipe(**content["env"])
    except UNFITTING as error:
        raise CheckpointError(f"{path} does not fit together: {str(error).splitlines()[0]}") from error


def _sizes(space: Space[Any]) -> int | list[int]:
    """Sizes of an action space: the choices of each discrete action, or the numbers of a real one."""
    match space:
        case spaces.Discrete():
            return [int(space.n)]
        case spaces.MultiDiscrete():
            return [int(n) for n in space.nvec]
    assert space.shape is not None
    return int(np.prod(space.shape))


def _space(sizes: int | list[int]) -> Space[Any]:
    """An action space of these sizes."""
    return spaces.Box(-1.0, 1.0, (sizes,)) if isinstance(sizes, int) else spaces.MultiDiscrete(sizes)
