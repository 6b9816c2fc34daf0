"""LRWR, episodic logistic reward-weighted regression: chapter 6 of the thesis (algorithm 6.1).

Reinforcement learning by imitation: the policy plays a batch of episodes, and is then trained, by supervised learning,
to do again what it did, the more so the better it went.

    E-step    u_i    =  exp(tau (R_i - max R))                          utility of episode i           (6.2)
    M-step    theta  =  argmax  sum_i u_i sum_t log pi(a_t | h_t)       until it generalises no more   (6.3, 6.2.4)
              tau    =  sum_i u_i / sum_i u_i (R_i - min R)                                            (6.4)

The one thing to understand: utilities are never negative, so a policy is taught even by what went badly, and with few
episodes mostly by chance. How often it takes each action is known, though: the mean utility's share of the sum is put
in exactly, as the cross-entropy with the policy that played, and only differences in utility are left to be sampled.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from typing_extensions import override

from dpsearch.algos.advantages import RunningScale
from dpsearch.algos.base import Algorithm, Env, Metrics
from dpsearch.algos.baselines.base import SharedBaseline
from dpsearch.algos.optimizers import OPTIMIZERS, make_optimizer
from dpsearch.algos.settings import FINITE, positive_or_none, require
from dpsearch.policies import PolicyConfig
from dpsearch.rollout import Episodes

BASELINES = ("none", "shared")
LOSSES = ("likelihood", "squared")
SCALE_MEMORY = 0.98  # of the running scale of gains, from batch to batch
FADED = 1e-3  # steps that count for less, by discount, are left out


@dataclass
class LRWRConfig:
    """How LRWR learns. The defaults are the thesis's (section 6.3.6), and where it is silent, what measures best.

    Attributes:
        batch_size: Episodes N of one EM step, at least 2 (thesis: 30, and 75 on CheeseMaze and T-maze).
        gamma: Discount factor of the returns, in (0, 1].
        baseline: ``"none"``: an episode's utility counts for all of its steps. ``"shared"``: each step has a utility of
            its own, by how much better than expected the return from there on was (section 6.4); what to expect is a
            linear read-out of the policy's memory, trained along with it.
        baseline_weight: Weight of the shared baseline's squared error, in units of the mean square gain.
        discount_steps: Count step t of an episode by gamma^t. The return at t = 0 says no more than that about what was
            done at t; the rest is chance, which in episodes of 1000 steps drowns everything. It has no place where
            steps have gains of their own.
        imitated_steps: Most steps of an episode that are imitated, and that the baseline learns from: its first; None
            for all. What comes later counts in their returns all the same. In shuttle docking 500 of 1000 teach no
            less. With ``discount_steps`` those that count for nothing are left out in any case.
        control_variate: Put the mean utility's share of the log-likelihood in exactly, for all actions by their
            probabilities, and sample the rest only. The expected loss stays what it is, but for 1/N of it, an episode's
            share in its own mean; there is less noise.
        tau: How steeply exponential utility rises at first, per unit of return (thesis: 1); None for what equation 6.4
            gives if all episodes of the first batch count alike. With 1, and returns from -100 to 10, a single lucky
            episode would be all there is to imitate.
        steepness: If given, tau is this over the gains' root mean square in recent batches, instead of equation 6.4's,
            which one disaster in a batch makes too small to tell the rest apart.
        loss: ``"likelihood"``: weighted log-likelihood, what section 6.2.4 derives. ``"squared"``: squared error of the
            probabilities, as algorithm 6.1 approximates it; without a control variate.
        held_out: Part of a batch that is not trained on but says when to stop, in [0, 1); 0 trains ``max_epochs``.
        patience: Epochs without improvement on the held-out episodes after which training ends.
        max_epochs: Most epochs in one EM step. An epoch is one step along the gradient of the whole batch. In the end
            the weights that were best on the held-out episodes are put back, but no earlier ones than after one step:
            what a few episodes say about that is mostly chance, and many batches would teach nothing.
        optimizer: Name of a class in ``torch.optim``. What it remembers, such as its momentum, is kept from one EM step
            to the next, so that what batches agree on adds up.
        learning_rate: Its step size, for the loss summed over all steps of the batch, by weight.
        learning_rate_halflife: Updates after which the step size has fallen to half; None keeps it.
        optimizer_options: Its other arguments; None is a momentum of 0.95 for SGD, and its own defaults for others.
    """

    batch_size: int = 30
    gamma: float = 0.98
    baseline: str = "none"
    baseline_weight: float = 0.03
    discount_steps: bool = True
    imitated_steps: int | None = None
    control_variate: bool = True
    tau: float | None = None
    steepness: float | None = None
    loss: str = "likelihood"
    held_out: float = 1.0 / 3.0
    patience: int = 10
    max_epochs: int = 30
    optimizer: str = "SGD"
    learning_rate: float = 0.002
    learning_rate_halflife: float | None = None
    optimizer_options: Any = None  # a dict: OmegaConf cannot merge one into an optional one

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field if a value is out of range."""
        require(
            self,
            {
                "batch_size": (isinstance(self.batch_size, int) and self.batch_size >= 2, "a whole number, at least 2"),
                "gamma": (0.0 < self.gamma <= 1.0, "in (0, 1]"),
                "baseline": (self.baseline in BASELINES, f"one of {', '.join(BASELINES)}"),
                "baseline_weight": (0.0 <= self.baseline_weight < math.inf, "0 or more"),
                "discount_steps": (not self.discount_steps or self.baseline == "none", "false with a baseline"),
                "imitated_steps": (
                    self.imitated_steps is None or (isinstance(self.imitated_steps, int) and self.imitated_steps >= 1),
                    "a whole number, at least 1, or null",
                ),
                "tau": (positive_or_none(self.tau), FINITE),
                "steepness": (
                    positive_or_none(self.steepness) and (self.steepness is None or self.tau is None),
                    "positive and finite, or null; tau, which it takes the place of, must be null beside it",
                ),
                "loss": (self.loss in LOSSES, f"one of {', '.join(LOSSES)}"),
                "control_variate": (not self.control_variate or self.loss == "likelihood", "false with loss=squared"),
                "held_out": (0.0 <= self.held_out < 1.0, "in [0, 1)"),
                "patience": (isinstance(self.patience, int) and self.patience >= 1, "a whole number, at least 1"),
                "max_epochs": (isinstance(self.max_epochs, int) and self.max_epochs >= 1, "a whole number, at least 1"),
                "optimizer": (self.optimizer in OPTIMIZERS, f"one of {', '.join(OPTIMIZERS)}"),
                "learning_rate": (0.0 < self.learning_rate < math.inf, "positive and finite"),
                "learning_rate_halflife": (positive_or_none(self.learning_rate_halflife), FINITE),
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
        self.baseline: SharedBaseline | None = None
        if self.config.baseline == "shared":
            self.baseline = SharedBaseline(self.policy.hidden_size, self.config.baseline_weight)
            self.parameters = [*self.parameters, *self.baseline.parameters()]
        self.gain_scale = RunningScale(SCALE_MEMORY)
        self.optimizer = self._make_optimizer()
        weights, outputs = torch.zeros(1), torch.zeros(1, self.policy.head.n_outputs)
        losses_of = self._losses(torch.zeros(1, self.policy.head.action_size), weights, outputs, weights)
        losses_of(outputs)  # refused now, if it is

    def _make_optimizer(self) -> torch.optim.Optimizer:
        config = self.config
        options = config.optimizer_options
        if options is None:
            options = {"momentum": 0.95} if config.optimizer == "SGD" else {}
        return make_optimizer(config.optimizer, self.parameters, config.learning_rate, options)

    def update(self) -> Metrics:
        """One EM step: play a batch, imitate its best episodes, adapt tau (algorithm 6.1)."""
        start, config = perf_counter(), self.config
        played = self.play_batch(config.batch_size)
        sampled = perf_counter()
        episodes = played.first(self._horizon)
        returns = played.returns_to_go(config.gamma)[: len(episodes.rewards)]  # R_t, (T, N)
        features = self._remember(episodes)  # (T, N, H)
        gains, whose = self._gains(episodes, returns, features)  # (M,) and (T, N)
        self.gain_scale.note(gains)
        if config.steepness is not None:
            self.tau = config.steepness / self.gain_scale.value
        elif self.tau is None:
            self.tau = adapted_tau(gains, np.ones(len(gains))) or 1.0
        utilities = np.exp(self.tau * (gains - gains.max()))  # (M,), the best one 1, equation 6.2
        if config.learning_rate_halflife is not None:
            for group in self.optimizer.param_groups:
                group["lr"] = config.learning_rate * 0.5 ** (self.updates / config.learning_rate_halflife)
        epochs = self.imitate(episodes, utilities[whose], features, returns)
        if config.steepness is None:
            self.tau = adapted_tau(gains, utilities) or self.tau
        self.updates += 1
        return {
            "return": float(played.returns.mean()),
            "episode_length": played.steps / len(played),
            "tau": self.tau,
            "effective_part": float(utilities.sum() ** 2 / np.square(utilities).sum()) / len(utilities),
            "epochs": epochs,
            "time/sample": sampled - start,
            "time/imitate": perf_counter() - sampled,
        }

    @property
    def _horizon(self) -> int | None:
        """Steps of an episode that are imitated; None for all. Those that by discount count for nothing are not."""
        gamma = self.config.gamma
        if self.config.discount_steps and gamma < 1.0:
            faded = math.ceil(math.log(FADED) / math.log(gamma))
            return min(faded, self.config.imitated_steps or faded)
        return self.config.imitated_steps

    def _remember(self, episodes: Episodes) -> Tensor:
        """The policy's memory, ``(T, N, H)``, with the graph that leads to its weights."""
        observations, actions = torch.from_numpy(episodes.observations), torch.from_numpy(episodes.actions)
        return self.policy.unroll(observations, actions, episodes.seen)

    def _gains(
        self, episodes: Episodes, returns: NDArray[np.float32], features: Tensor
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """What utilities judge, ``(M,)``, and whose utility counts for each step, ``(T, N)``: episodes', or steps'."""
        mask = episodes.mask
        if self.baseline is None:
            return returns[0].astype(np.float64), np.broadcast_to(np.arange(len(episodes)), mask.shape)
        surprises = returns - self.baseline.expected(episodes, features)
        return surprises[mask].astype(np.float64), np.cumsum(mask).reshape(mask.shape) - 1

    def imitate(
        self, episodes: Episodes, utilities: NDArray[np.float64], features: Tensor, returns: NDArray[np.float32]
    ) -> int:
        """Train the policy to do what it did until it generalises no more (6.2.4).

        Args:
            episodes: What it did.
            utilities: How much each step counts, ``(T, N)``.
            features: What it remembered as it did it, ``(T, N, H)``, with the graph that leads to its weights.
            returns: R_t, ``(T, N)``, for the baseline to learn.

        Returns:
            Gradient steps taken.
        """
        config, mask = self.config, episodes.mask
        n_held = min(round(config.held_out * len(episodes)), len(episodes) - 1)  # the last ones: all are alike
        trained = np.arange(len(episodes)) < len(episodes) - n_held
        fading = config.gamma ** np.arange(len(mask)) if config.discount_steps else np.ones(len(mask))
        counted = mask * fading[:, None]  # (T, N)
        mean = float(utilities[mask].mean())
        weights, known = ((u * counted).astype(np.float32) for u in (utilities, mean * config.control_variate))
        actions = torch.from_numpy(episodes.actions)
        outputs = self.policy.distribution(features, actions)  # (T, N, K)
        losses_of = self._losses(actions, torch.from_numpy(weights), outputs.detach(), torch.from_numpy(known))
        best, best_loss, since = self.policy.vector(), math.inf, 0
        epochs = 0
        while True:
            losses = losses_of(outputs)  # (T, N)
            if n_held:
                unseen = float(losses.detach()[:, -n_held:].sum())
                since = 0 if unseen < best_loss or epochs <= 1 else since + 1
                if since == 0:
                    best, best_loss = self.policy.vector(), unseen
                if since >= config.patience or epochs == config.max_epochs:
                    self.policy.load_vector(best)
                    return epochs
            loss = losses[:, : len(episodes) - n_held].sum()
            if self.baseline is not None:
                _, error = self.baseline(episodes, features, returns, mask & trained)
                loss = loss + mean / self.gain_scale.value**2 * error
            if not torch.isfinite(loss):
                raise FloatingPointError(f"the loss of update {self.updates} is not finite: the steps are too large")
            for parameter in self.parameters:
                parameter.grad = None  # optimizer.zero_grad() takes ten times longer
            loss.backward()
            self.optimizer.step()
            epochs += 1
            if epochs == config.max_epochs and not n_held:
                return epochs
            features = self._remember(episodes)
            outputs = self.policy.distribution(features, actions)

    def _losses(self, actions: Tensor, weights: Tensor, before: Tensor, known: Tensor) -> Callable[[Tensor], Tensor]:
        """What makes equation 6.2.4, by steps ``(T, N)``, of the policy's outputs; see ``Head.imitation_loss``."""
        head = self.policy.head
        if self.config.loss == "squared":
            return lambda outputs: weights * head.squared_error(outputs, actions)
        return head.imitation_loss(actions, weights, before, known)

    @override
    def state_dict(self) -> dict[str, Any]:
        return {
            **super().state_dict(),
            "tau": self.tau,
            "optimizer": self.optimizer.state_dict(),
            "baseline": None if self.baseline is None else self.baseline.state_dict(),
            "gain_scale": self.gain_scale.state_dict(),
        }

    @override
    def load_state_dict(self, state: dict[str, Any]) -> None:
        super().load_state_dict(state)
        self.tau = state["tau"]
        self.optimizer.load_state_dict(state["optimizer"])
        if self.baseline is not None:
            self.baseline.load_state_dict(state["baseline"])
        self.gain_scale.load_state_dict(state["gain_scale"])


def adapted_tau(gains: NDArray[np.float64], utilities: NDArray[np.float64]) -> float | None:
    """Equation 6.4, with the least gain for 0, so that tau is positive; None if all gains ``(M,)`` are alike."""
    above = float((utilities * (gains - gains.min())).sum())
    return float(utilities.sum()) / above if above > 0.0 else None
