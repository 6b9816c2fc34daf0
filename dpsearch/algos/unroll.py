"""A policy on recorded episodes: its memory at each step, and its outputs, with the graph that leads to its weights."""

from __future__ import annotations

import torch
from torch import Tensor

from dpsearch.policies import RecurrentPolicy
from dpsearch.rollout import Episodes


def unroll(policy: RecurrentPolicy, episodes: Episodes) -> Tensor:
    """The policy's memory ``(T, N, H)`` at each step, by a fused call of the core or a few; no meaning on padding."""
    observations, actions = torch.from_numpy(episodes.observations), torch.from_numpy(episodes.actions)
    return policy.unroll(observations, actions, episodes.seen, _state(episodes))


def outputs_of(policy: RecurrentPolicy, episodes: Episodes, features: Tensor) -> Tensor:
    """The policy's outputs ``(T, N, K)``, parameters of pi(.|h_t), where its memory was ``(T, N, H)``."""
    return policy.distribution(features, torch.from_numpy(episodes.actions), _state(episodes))


def _state(episodes: Episodes) -> Tensor | None:
    """The recurrent state before the first step, ``(N, state_size)``; None for zeros."""
    return None if episodes.state is None else torch.from_numpy(episodes.state)
