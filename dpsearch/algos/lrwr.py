"""LRWR, episodic logistic reward-weighted regression: chapter 6 of the thesis (algorithm 6.1).

Reinforcement learning by imitation: the policy plays a batch of episodes, and is then trained, by supervised learning,
to do again what it did, the better it went the more.

    E-step    u_i    =  exp(tau (R_i - max R))                          utility of episode i           (6.2)
    M-step    theta  =  argmax  sum_i u_i sum_t log pi(a_t | h_t)       until it generalises no more   (6.3, 6.2.4)
              tau    =  sum_i u_i / sum_i u_i (R_i - min R)                                            (6.4)

The one thing to understand: utilities are never negative, so bad episodes are imitated too, and what a few episodes
happened to do is mostly noise. A control variate reduces it: the mean-utility part of the loss has a closed form, the
cross-entropy with the policy that played, so that only differences in utility are sampled.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dpsearch.algos.advantages import RunningScale
from dpsearch.algos.base import Algorithm, Env, Metrics
from dpsearch.algos.baselines import baseline_config
from dpsearch.algos.baselines.base import BaselineConfig
from dpsearch.algos.baselines.shared import SharedBaseline, SharedConfig
from dpsearch.algos.optimizers import OPTIMIZERS, make_optimizer, set_learning_rate
from dpsearch.algos.settings import FINITE, is_whole, positive_or_none, require
from dpsearch.algos.unroll import outputs_of, unroll
from dpsearch.policies import PolicyConfig, RecurrentPolicy
from dpsearch.rollout import Episodes

BASELINES: dict[str, BaselineConfig] = {"none": BaselineConfig(), "shared": SharedConfig(weight=0.03)}
"""Baselines that LRWR can have, by kind, with their default settings."""
LOSSES = ("likelihood", "squared")
SCALE_MEMORY = 0.98  # decay of the running scale of gains, from batch to batch
FADED = 1e-3  # weight by discount below which steps are left out


@dataclass
class LRWRConfig:
    """Settings of LRWR. The defaults are the thesis's (section 6.3.6), and where it is silent, those that measure best.

    Attributes:
        batch_size: Episodes N of one EM step, at least 2 (thesis: 30, and 75 on CheeseMaze and T-maze).
        gamma: Discount factor of the returns, in (0, 1].
        baseline: Kind of the baseline, alone or with its settings, ``{kind: shared, weight: 0.03}``.
            ``none``: an episode's utility counts for all of its steps.
            ``shared`` (``weight``): each step has a utility of its own, by how much the return from there on exceeds
            the baseline (section 6.4), a linear read-out of the policy's memory, trained along with it. The weight is
            that of its squared error, in units of the mean square gain.
        discount_steps: Weight step t by gamma^t: the action at t affects the return only by that factor, and the rest
            of the return is noise, which in episodes of 1000 steps drowns everything. It has no place where steps have
            gains of their own.
        imitated_steps: Number of first steps of an episode that are imitated, and that the baseline learns from; None
            for all. Later steps still count in the returns. In shuttle docking 500 of 1000 teach no less. With
            ``discount_steps``, steps of a weight near 0 are left out in any case.
        control_variate: Give the mean utility's part of the log-likelihood its closed form, over all actions by their
            probabilities, and sample only the rest. The expected loss stays what it is, except for 1/N of it, an
            episode's share in its own mean; there is less noise. False is the thesis's estimate.
        tau: Initial slope of the exponential utility, per unit of return (thesis: 1); None for the value of equation
            6.4 if all episodes of the first batch count alike. With 1, and returns from -100 to 10, a single lucky
            episode would be all there is to imitate.
        steepness: If given, tau is this over the root mean square of recent gains, instead of equation 6.4's, which one
            disaster in a batch makes too small to tell the rest apart.
        loss: ``"likelihood"``: weighted log-likelihood, as section 6.2.4 derives it. ``"squared"``: squared error of
            the probabilities, as algorithm 6.1 approximates it; without a control variate.
        held_out: Part of a batch that is not trained on but says when to stop, in [0, 1); 0 trains ``max_epochs``.
        patience: Epochs without improvement on the held-out episodes after which training ends.
        max_epochs: Most epochs in one EM step. An epoch is one step along the gradient of the whole batch. In the end
            the weights that were best on the held-out episodes are restored, but none from before the first step: a few
            held-out episodes are noisy, and many batches would teach nothing.
        optimizer: Name of a class in ``torch.optim``. Its state, such as momentum, is kept from one EM step to the
            next, so that gradients on which batches agree add up.
        learning_rate: Step size of the optimiser, for the loss summed over all steps of the batch, by weight.
        learning_rate_halflife: Updates after which the step size has fallen to half; None keeps it.
        optimizer_options: Other arguments of the optimiser; None for a momentum of 0.95 with SGD, and for the
            defaults of other classes.
    """

    batch_size: int = 30
    gamma: float = 0.98
    baseline: Any = field(default_factory=lambda: {"kind": "none"})  # a BaselineConfig once checked
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
        """Raise a ValueError that names the setting if a value is out of range."""
        self.baseline = baseline_config(self.baseline, BASELINES)
        whole = "a whole number, at least 1"
        require(
            self,
            {
                "batch_size": (is_whole(self.batch_size, 2), "a whole number, at least 2"),
                "gamma": (0.0 < self.gamma <= 1.0, "in (0, 1]"),
                "discount_steps": (not self.discount_steps or self.baseline.kind == "none", "false with a baseline"),
                "imitated_steps": (
                    self.imitated_steps is None or is_whole(self.imitated_steps, 1),
                    f"{whole}, or null",
                ),
                "tau": (positive_or_none(self.tau), FINITE),
                "steepness": (
                    positive_or_none(self.steepness) and (self.steepness is None or self.tau is None),
                    "positive and finite, or null; tau, which it takes the place of, must be null beside it",
                ),
                "loss": (self.loss in LOSSES, f"one of {', '.join(LOSSES)}"),
                "control_variate": (not self.control_variate or self.loss == "likelihood", "false with loss=squared"),
                "held_out": (0.0 <= self.held_out < 1.0, "in [0, 1)"),
                "patience": (is_whole(self.patience, 1), whole),
                "max_epochs": (is_whole(self.max_epochs, 1), whole),
                "optimizer": (self.optimizer in OPTIMIZERS, f"one of {', '.join(OPTIMIZERS)}"),
                "learning_rate": (0.0 < self.learning_rate < math.inf, "positive and finite"),
                "learning_rate_halflife": (positive_or_none(self.learning_rate_halflife), FINITE),
            },
        )

    def check_policy(self, policy: RecurrentPolicy) -> None:
        """Raise a ValueError if the policy has no such loss."""
        head = policy.head
        if head.draws == 0:
            raise ValueError(f"policy must sample its actions, this one's head is {type(head).__name__}")
        if self.loss == "squared" and not head.one_hot:
            raise ValueError(
                f"loss must be likelihood: squared needs discrete actions, this policy's head is {type(head).__name__}"
            )


class LRWR(Algorithm[LRWRConfig]):
    """Episodic logistic reward-weighted regression; see ``Algorithm`` for the arguments.

    Attributes:
        tau: Present slope of the exponential utility, per unit of return; None before the first batch.
    """

    name = "lrwr"
    config_type = LRWRConfig
    default_policy = PolicyConfig(hidden_size=2, init_range=0.1)
    parts = (*Algorithm.parts, "optimizer", "baseline", "gain_scale")
    values = (*Algorithm.values, "tau")

    def __init__(self, env: Env, config: LRWRConfig | None = None, **options: Any) -> None:
        super().__init__(env, config, **options)
        self.config.check_policy(self.policy)
        self.tau = self.config.tau
        self.parameters = self.policy.free_parameters()
        self.baseline: SharedBaseline | None = None
        if isinstance(self.config.baseline, SharedConfig):
            self.baseline = SharedBaseline(self.config.baseline, self.policy, self.seed)
            self.parameters = [*self.parameters, *self.baseline.parameters()]
        self.gain_scale = RunningScale(SCALE_MEMORY)
        self.optimizer = self._make_optimizer()

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
        episodes = played.first(self.horizon)
        returns = played.returns_to_go(config.gamma)[: len(episodes.rewards)]  # R_t, (T, N)
        features = unroll(self.policy, episodes)  # (T, N, H)
        gains, whose = self.gains(episodes, returns, features)  # (M,) and (T, N)
        self.gain_scale.note(gains)
        if config.steepness is not None:
            self.tau = config.steepness / self.gain_scale.value
        elif self.tau is None:
            self.tau = adapted_tau(gains, np.ones(len(gains))) or 1.0
        utilities = np.exp(self.tau * (gains - gains.max()))  # (M,), the best one 1, equation 6.2
        if config.learning_rate_halflife is not None:
            faded = 0.5 ** (self.updates / config.learning_rate_halflife)
            set_learning_rate(self.optimizer, config.learning_rate * faded)
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
    def horizon(self) -> int | None:
        """Number of first steps of an episode that are imitated; None for all. Steps of a weight near 0 are not."""
        gamma = self.config.gamma
        if self.config.discount_steps and gamma < 1.0:
            faded = math.ceil(math.log(FADED) / math.log(gamma))
            return min(faded, self.config.imitated_steps or faded)
        return self.config.imitated_steps

    def gains(
        self, episodes: Episodes, returns: NDArray[np.float32], features: Tensor
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """The gains of which utilities are made: returns of episodes, or, with a baseline, advantages of steps.

        Args:
            episodes: N episodes of up to T steps.
            returns: R_t, ``(T, N)``.
            features: The policy's memory, ``(T, N, H)``.

        Returns:
            Gains ``(M,)``, and for each step the number of its gain, ``(T, N)``.
        """
        mask = episodes.mask
        if self.baseline is None:
            return returns[0].astype(np.float64), np.broadcast_to(np.arange(len(episodes)), mask.shape)
        surprises = returns - self.baseline.expected(episodes, features)
        return surprises[mask].astype(np.float64), np.cumsum(mask).reshape(mask.shape) - 1

    def imitate(
        self, episodes: Episodes, utilities: NDArray[np.float64], features: Tensor, returns: NDArray[np.float32]
    ) -> int:
        """Train the policy to repeat the actions taken, until that generalises no more (6.2.4).

        Args:
            episodes: N episodes of up to T steps.
            utilities: Weight of each step, ``(T, N)``.
            features: The policy's memory in the episodes, ``(T, N, H)``, with the graph that leads to its weights.
            returns: R_t, ``(T, N)``, for the baseline to learn.

        Returns:
            Gradient steps taken.
        """
        config, mask = self.config, episodes.mask
        n_held = min(round(config.held_out * len(episodes)), len(episodes) - 1)  # the last ones: order is random
        trained = np.arange(len(episodes)) < len(episodes) - n_held
        fading = config.gamma ** np.arange(len(mask)) if config.discount_steps else np.ones(len(mask))
        counted = mask * fading[:, None]  # (T, N)
        mean = float(utilities[mask].mean())
        weights, known = ((u * counted).astype(np.float32) for u in (utilities, mean * config.control_variate))
        actions = torch.from_numpy(episodes.actions)
        outputs = outputs_of(self.policy, episodes, features)  # (T, N, K)
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
            features = unroll(self.policy, episodes)
            outputs = outputs_of(self.policy, episodes, features)

    def _losses(self, actions: Tensor, weights: Tensor, before: Tensor, known: Tensor) -> Callable[[Tensor], Tensor]:
        """Function from the policy's outputs to the loss of 6.2.4, by steps ``(T, N)``; see ``Head.imitation_loss``."""
        head = self.policy.head
        if self.config.loss == "squared":
            return lambda outputs: weights * head.squared_error(outputs, actions)
        return head.imitation_loss(actions, weights, before, known)


def adapted_tau(gains: NDArray[np.float64], utilities: NDArray[np.float64]) -> float | None:
    """Tau by equation 6.4, from gains ``(M,)`` less their least, so that tau is positive; None if all are equal."""
    above = float((utilities * (gains - gains.min())).sum())
    return float(utilities.sum()) / above if above > 0.0 else None
