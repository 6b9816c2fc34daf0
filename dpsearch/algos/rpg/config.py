"""How RPG learns: its settings, and what each may be."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from dpsearch.algos.optimizers import OPTIMIZERS
from dpsearch.algos.settings import FINITE, positive_or_none, require

BASELINES = ("constant", "shared", "history", "quadratic")


@dataclass
class RPGConfig:
    """How RPG learns. The defaults are the thesis's best for the T-maze (section 3.4.2).

    Attributes:
        batch_size: Episodes N of one update, if ``update_steps`` is not given; the thesis's standard elsewhere is 1.
        gamma: Discount factor of the returns R_t, in (0, 1].
        optimizer: Name of a class in ``torch.optim`` (those in ``OPTIMIZERS``).
        learning_rate: Its step size alpha.
        learning_rate_halflife: Updates after which alpha has fallen to half; None keeps it.
        optimizer_options: Its other arguments, such as ``{momentum: 0.9}``.
        gradient_length: Length that the gradient is normalised to before the step; None leaves it as it is.
        baseline: ``"constant"``: b is the mean of all R_t of the last ``baseline_episodes`` episodes (section 3.3.2).
            ``"shared"``: b(h_t) is a linear read-out of the policy's own memory, trained on the returns received in
            the same backward pass. It teaches the memory to hold what returns depend on, long before the policy can
            profit from it.
            ``"history"``: b(h_t) is what a second LSTM expects, which sees the same history and is trained on the
            returns received (section 3.3.2); see ``HistoryBaseline``.
            ``"quadratic"``: b(o_t) is the quadratic function of the observation that fits the returns of late best: of
            use at once, without memory.
        baseline_episodes: Episodes in the constant baseline's moving average; 0 for no baseline.
        baseline_weight: Weight of the shared baseline's squared error in the loss.
        baseline_cells: Of the history baseline.
        baseline_optimizer: Of the history baseline, like ``optimizer``.
        baseline_learning_rate: Its step size, for the squared error averaged over steps, of returns scaled to
            deviation 1.
        baseline_optimizer_options: Its other arguments.
        baseline_steps: Gradient steps of the history baseline after every batch.
        batch_steps: If given, a batch has as many episodes as it takes to play about this many environment steps,
            judged by the mean length in the batch before (``batch_size`` is the least, 64 times that the most), so
            that the long episodes of an unskilled policy do not use up the time.
        trace: Lambda of the generalised advantage estimate (Schulman et al., ICLR 2016), in [0, 1]: 1 weights
            eligibilities by R_t - b as in section 3.3.2; less trusts the baseline for what comes later, which is less
            noisy and, as far as the baseline is wrong, biased.
        normalise_advantages: Divide advantages by their root mean square over recent batches, so that learning rate and
            ``entropy_bonus`` mean the same on every task. A batch is not scaled by itself alone: that would make rare
            disasters count for little.
        advantage_memory: Of that running mean, from batch to batch; 1 for the mean over all batches, so that a policy
            that has learned to avoid disasters is not unsettled by trifles that come to look large beside one another.
        entropy_bonus: Weight of the entropy, summed over an episode's steps: keeps a policy from settling too early.
        entropy_halflife: Updates after which the bonus has fallen to half; None keeps it.
        natural_step: If given, the gradient is replaced by the natural one (see ``natural_gradient``), of the length
            that, at a ``learning_rate`` of 1, makes the actions' distribution at an average step differ by this many
            nats of KL divergence, however the weights are scaled: no more than can be judged from one batch.
        damping: Added to the diagonal of the Fisher information matrix of the natural gradient.
        restart_episodes: If given, learning begins again from other random weights whenever so many episodes brought it
            no further: on some tasks most starts lead to a policy that is hard to improve, and a few lead past it.
        restart_gain: By which share of its size the mean discounted return has to rise within them; see ``Progress``.
        update_steps: If given, learn from one continuing stream, every so many steps, instead of from batches of whole
            episodes: for tasks that go on (section 3.4.4). The gradient is cut off where the update is, the recurrent
            state is carried on, and what the baseline expects there completes the returns.
        mirror: If left and right are alike: by what a mirror multiplies each number of an observation and then of an
            action, 1 or -1. Natural steps of a Gaussian policy, and baselines, then fit images too; see ``Mirror``.
        variance_scaled: Scale a Gaussian policy's eligibilities by sigma^2 (Williams 1992): finite as sigma goes to 0.
    """

    batch_size: int = 20
    gamma: float = 0.98
    optimizer: str = "SGD"
    learning_rate: float = 1.0
    learning_rate_halflife: float | None = None
    optimizer_options: dict[str, Any] = field(default_factory=dict)
    gradient_length: float | None = 0.3
    baseline: str = "constant"
    baseline_episodes: int = 100
    baseline_weight: float = 0.1
    baseline_cells: int = 10
    baseline_optimizer: str = "Adam"
    baseline_learning_rate: float = 0.01
    baseline_optimizer_options: dict[str, Any] = field(default_factory=dict)
    baseline_steps: int = 1
    batch_steps: int | None = None
    trace: float = 1.0
    normalise_advantages: bool = False
    advantage_memory: float = 0.98
    entropy_bonus: float = 0.0
    entropy_halflife: float | None = None
    natural_step: float | None = None
    damping: float = 0.01
    restart_episodes: int | None = None
    restart_gain: float = 0.0
    update_steps: int | None = None
    mirror: Any = None  # a list: OmegaConf would resolve one too early
    variance_scaled: bool = False

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field if a value is out of range."""
        require(
            self,
            {
                "batch_size": (isinstance(self.batch_size, int) and self.batch_size >= 1, "a whole number, at least 1"),
                "gamma": (0.0 < self.gamma <= 1.0, "in (0, 1]"),
                "learning_rate": (0.0 < self.learning_rate < math.inf, "positive and finite"),
                "learning_rate_halflife": (positive_or_none(self.learning_rate_halflife), FINITE),
                "trace": (0.0 <= self.trace <= 1.0, "in [0, 1]"),
                "advantage_memory": (0.0 < self.advantage_memory <= 1.0, "in (0, 1]"),
                "gradient_length": (positive_or_none(self.gradient_length), FINITE),
                "baseline": (self.baseline in BASELINES, f"one of {', '.join(BASELINES)}"),
                "baseline_weight": (self.baseline_weight >= 0.0, "0 or more"),
                "baseline_cells": (self.baseline_cells >= 1, "at least 1"),
                "baseline_optimizer": (self.baseline_optimizer in OPTIMIZERS, f"one of {', '.join(OPTIMIZERS)}"),
                "baseline_learning_rate": (0.0 < self.baseline_learning_rate < math.inf, "positive and finite"),
                "baseline_steps": (self.baseline_steps >= 1, "at least 1"),
                "batch_steps": (self.batch_steps is None or self.batch_steps >= 1, "at least 1 or null"),
                "baseline_episodes": (self.baseline_episodes >= 0, "0 or more"),
                "entropy_bonus": (0.0 <= self.entropy_bonus < math.inf, "0 or more"),
                "entropy_halflife": (positive_or_none(self.entropy_halflife), FINITE),
                "natural_step": (
                    self.natural_step is None or (self.natural_step > 0.0 and self._leaves_the_step_alone),
                    "positive or null; with it, gradient_length must be null, optimizer SGD, baseline not shared and "
                    "variance_scaled false; natural_step=null takes plain gradients",
                ),
                "restart_episodes": (
                    self.restart_episodes is None or (self.restart_episodes >= 1 and self.update_steps is None),
                    "at least 1, and without update_steps, or null",
                ),
                "restart_gain": (0.0 <= self.restart_gain < math.inf, "0 or more"),
                "damping": (0.0 <= self.damping < math.inf, "0 or more"),
                "update_steps": (
                    self.update_steps is None or (self.update_steps >= 1 and self.batch_steps is None),
                    "at least 1 or null; batch_steps, which is for batches of whole episodes, must be null beside it",
                ),
                "mirror": (
                    self.mirror is None
                    or not (self.natural_step is None or (self.update_steps and self.baseline == "history")),
                    "null without a natural_step, and with a history baseline of a stream, which carries one memory on",
                ),
                "optimizer": (self.optimizer in OPTIMIZERS, f"one of {', '.join(OPTIMIZERS)}"),
            },
        )

    @property
    def _leaves_the_step_alone(self) -> bool:
        """Whether nothing else turns the gradient or changes its length."""
        unscaled = self.gradient_length is None and not self.variance_scaled
        return unscaled and self.optimizer == "SGD" and self.baseline != "shared"
