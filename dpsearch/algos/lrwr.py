"""LRWR, episodic logistic reward-weighted regression: chapter 6 of the thesis (algorithm 6.1).

Reinforcement learning by imitation: the policy plays a batch of episodes, and is then trained, by supervised learning,
to do again what it did, the more so the better it went.

    E-step    u_i    =  exp(tau (R_i - max R))                          utility of episode i           (6.2)
    M-step    theta  =  argmax  sum_i u_i sum_t log pi(a_t | h_t)       until it generalises no more   (6.3, 6.2.4)
              tau    =  sum_i u_i / sum_i u_i (R_i - min R)                                            (6.4)

The one thing to understand: the weights say which episodes to imitate, and are never negative. What the policy did is
its only teacher, so an action that was not tried in a batch cannot be learned from it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from typing_extensions import override

from dpsearch.algos.base import BASELINE, Algorithm, Env, Metrics
from dpsearch.algos.history_baseline import HistoryBaseline
from dpsearch.algos.optimizers import OPTIMIZERS, make_optimizer
from dpsearch.algos.settings import require
from dpsearch.kernels.philox import stream_key
from dpsearch.policies import PolicyConfig
from dpsearch.rollout import Episodes

UTILITIES = ("exponential", "rank")
BASELINES = ("none", "history")
LOSSES = ("likelihood", "squared")


@dataclass
class LRWRConfig:
    """How LRWR learns. The defaults are the thesis's (section 6.3.6).

    Attributes:
        batch_size: Episodes N of one EM step, at least 2 (thesis: 30, and 75 on CheeseMaze and T-maze).
        gamma: Discount factor of the returns, in (0, 1].
        utility: ``"exponential"``: u = exp(tau R), scaled so that the best of a batch weighs 1. ``"rank"``: the better
            half of a batch weighs from 0 to 1 by rank, whatever the size of the returns.
        baseline: ``"none"``: an episode's utility counts for all of its steps. ``"history"``: each step has a utility
            of its own, by how much better than expected the return from there on was; what to expect, a second LSTM
            learns (section 6.4).
        tau: How steeply exponential utility rises at first, per unit of return (thesis: 1); None for what equation 6.4
            gives if all episodes of the first batch count alike. With 1, and returns from -100 to 10, a single lucky
            episode would be all there is to imitate.
        adapt_tau: Adapt it after each EM step, equation 6.4. Utility by rank has no use for tau.
        loss: ``"likelihood"``: weighted log-likelihood, what section 6.2.4 derives. ``"squared"``: squared error of the
            probabilities, as algorithm 6.1 approximates it.
        held_out: Part of a batch that is not trained on but says when to stop, in [0, 1); 0 trains ``max_epochs``.
        patience: Epochs without improvement on the held-out episodes after which training ends, and the best weights so
            far are put back.
        max_epochs: Most epochs in one EM step; the weights are then the last ones. An epoch is one step along the
            gradient of the whole batch.
        optimizer: Name of a class in ``torch.optim``; it begins anew in each EM step.
        learning_rate: Its step size, for the loss summed over all steps of the batch, by weight.
        optimizer_options: Its other arguments; None is a momentum of 0.95 for SGD, and its own defaults for others.
    """

    batch_size: int = 30
    gamma: float = 0.98
    utility: str = "exponential"
    baseline: str = "none"
    tau: float | None = None
    adapt_tau: bool = True
    loss: str = "likelihood"
    held_out: float = 1.0 / 3.0
    patience: int = 5
    max_epochs: int = 100
    optimizer: str = "SGD"
    learning_rate: float = 0.002
    optimizer_options: Any = None  # a dict: OmegaConf cannot merge one into an optional one

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field if a value is out of range."""
        require(
            self,
            {
                "batch_size": (isinstance(self.batch_size, int) and self.batch_size >= 2, "a whole number, at least 2"),
                "gamma": (0.0 < self.gamma <= 1.0, "in (0, 1]"),
                "utility": (self.utility in UTILITIES, f"one of {', '.join(UTILITIES)}"),
                "baseline": (self.baseline in BASELINES, f"one of {', '.join(BASELINES)}"),
                "tau": (self.tau is None or 0.0 < self.tau < math.inf, "positive and finite, or null"),
                "loss": (self.loss in LOSSES, f"one of {', '.join(LOSSES)}"),
                "held_out": (0.0 <= self.held_out < 1.0, "in [0, 1)"),
                "patience": (isinstance(self.patience, int) and self.patience >= 1, "a whole number, at least 1"),
                "max_epochs": (isinstance(self.max_epochs, int) and self.max_epochs >= 1, "a whole number, at least 1"),
                "optimizer": (self.optimizer in OPTIMIZERS, f"one of {', '.join(OPTIMIZERS)}"),
                "learning_rate": (0.0 < self.learning_rate < math.inf, "positive and finite"),
            },
        )


class LRWR(Algorithm[LRWRConfig]):
    """Episodic logistic reward-weighted regression; see ``Algorithm`` for the arguments.

    Attributes:
        tau: How steeply utility rises now; None before the first batch.
    """

    name = "lrwr"
    config_type = LRWRConfig
    default_policy = PolicyConfig(hidden_size=2, init_range=0.1)

    def __init__(self, env: Env, config: LRWRConfig | None = None, **options: Any) -> None:
        super().__init__(env, config, **options)
        self.tau = self.config.tau
        self.parameters = self.policy.free_parameters()
        self.baseline: HistoryBaseline | None = None
        if self.config.baseline == "history":
            self.baseline = HistoryBaseline(
                self.policy.observation_size,
                self.policy.head,
                seed=stream_key(self.seed, BASELINE) >> 1,
            )

        self._make_optimizer()  # refused now if its options are wrong, not when it learns; the loss likewise
        self._losses(torch.zeros(1, self.policy.head.n_outputs), torch.zeros(1, self.policy.head.action_size))

    def _make_optimizer(self) -> torch.optim.Optimizer:
        config = self.config
        options = config.optimizer_options
        if options is None:
            options = {"momentum": 0.95} if config.optimizer == "SGD" else {}
        return make_optimizer(config.optimizer, self.parameters, config.learning_rate, options)

    def update(self) -> Metrics:
        """One EM step: play a batch, imitate its best episodes, adapt tau (algorithm 6.1)."""
        start = perf_counter()
        episodes = self.play_batch(self.config.batch_size)
        sampled = perf_counter()
        gains, steps = self._gains(episodes)  # (M,), of M episodes or steps, and which of them each step is, (T, N)
        if self.tau is None:
            self.tau = adapted_tau(gains, np.ones(len(gains))) or 1.0
        utilities = self.utilities(gains, self.tau)  # (M,)
        epochs = self.imitate(episodes, utilities[steps])
        if self.config.adapt_tau:
            self.tau = adapted_tau(gains, utilities) or self.tau
        self.updates += 1
        return {
            "return": float(episodes.returns.mean()),
            "episode_length": episodes.steps / len(episodes),
            "tau": self.tau,
            "effective_part": float(utilities.sum() ** 2 / np.square(utilities).sum()) / len(utilities),
            "epochs": epochs,
            "time/sample": sampled - start,
            "time/imitate": perf_counter() - sampled,
        }

    def _gains(self, episodes: Episodes) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """What utilities judge, ``(M,)``, and whose utility counts for each step, ``(T, N)``: episodes', or steps'."""
        mask = episodes.mask
        returns = episodes.returns_to_go(self.config.gamma)  # R_t, (T, N)
        if self.baseline is None:
            return returns[0].astype(np.float64), np.broadcast_to(np.arange(len(episodes)), mask.shape)
        expected, _ = self.baseline(episodes, torch.empty(0), returns, mask)
        return (returns - expected)[mask].astype(np.float64), np.cumsum(mask).reshape(mask.shape) - 1

    def utilities(self, gains: NDArray[np.float64], tau: float) -> NDArray[np.float64]:
        """How much each episode or step counts, by its gain ``(M,)``: in [0, 1], the best one 1 (equation 6.2)."""
        if self.config.utility == "exponential":
            weights: NDArray[np.float64] = np.exp(tau * (gains - gains.max()))
            return weights
        ranks = np.searchsorted(np.sort(gains), gains, side="right") / len(gains)  # equals share the best rank
        return np.maximum(2.0 * ranks - 1.0, 0.0)

    def imitate(self, episodes: Episodes, utilities: NDArray[np.float64]) -> int:
        """Train the policy to do what it did until it generalises no more (6.2.4).

        Args:
            episodes: What it did.
            utilities: How much each step counts, ``(T, N)``.

        Returns:
            Gradient steps taken.
        """
        config = self.config
        observations, actions = torch.from_numpy(episodes.observations), torch.from_numpy(episodes.actions)
        n_held = min(round(config.held_out * len(episodes)), len(episodes) - 1)  # the last ones: all are alike
        held = np.arange(len(episodes)) >= len(episodes) - n_held
        weights = torch.from_numpy((utilities * episodes.mask).astype(np.float32))
        train = weights[:, ~held]
        optimizer = self._make_optimizer()
        best, best_loss, since = self.policy.vector(), math.inf, 0
        for epoch in range(config.max_epochs):
            outputs, _ = self.policy(observations, actions=actions)  # (T, N, K)
            if n_held:
                unseen = float((self._losses(outputs[:, held].detach(), actions[:, held]) * weights[:, held]).sum())
                if unseen < best_loss:
                    best, best_loss, since = self.policy.vector(), unseen, 0
                else:
                    since += 1
                if since >= config.patience:
                    self.policy.load_vector(best)
                    return epoch
            optimizer.zero_grad()
            loss = (self._losses(outputs[:, ~held], actions[:, ~held]) * train).sum()
            if not torch.isfinite(loss):
                raise FloatingPointError(f"the loss of update {self.updates} is not finite: the steps are too large")
            loss.backward()
            optimizer.step()
        return config.max_epochs

    def _losses(self, outputs: Tensor, actions: Tensor) -> Tensor:
        """How far the policy is from doing what was done, ``(T, N)``."""
        head = self.policy.head
        return (
            -head.log_prob(outputs, actions)
            if self.config.loss == "likelihood"
            else head.squared_error(outputs, actions)
        )

    @override
    def state_dict(self) -> dict[str, Any]:
        baseline = None if self.baseline is None else self.baseline.state_dict()
        return {**super().state_dict(), "tau": self.tau, "baseline": baseline}

    @override
    def load_state_dict(self, state: dict[str, Any]) -> None:
        super().load_state_dict(state)
        self.tau = state["tau"]
        if self.baseline is not None:
            self.baseline.load_state_dict(state["baseline"])


def adapted_tau(gains: NDArray[np.float64], utilities: NDArray[np.float64]) -> float | None:
    """Equation 6.4, with the least gain for 0, so that tau is positive; None if all gains ``(M,)`` are alike."""
    above = float((utilities * (gains - gains.min())).sum())
    return float(utilities.sum()) / above if above > 0.0 else None
