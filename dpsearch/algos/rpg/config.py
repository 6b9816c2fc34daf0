"""The settings of RPG, and the values that each may have."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from dpsearch.algos.baselines import DEFAULTS, baseline_config
from dpsearch.algos.optimizers import OPTIMIZERS
from dpsearch.algos.settings import FINITE, is_whole, positive_or_none, require
from dpsearch.policies import RecurrentPolicy


@dataclass
class RPGConfig:
    """Settings of RPG. The defaults are the thesis's best for the T-maze (section 3.4.2).

    Attributes:
        batch_size: Episodes N of one update, if ``update_steps`` is not given; the thesis's standard is 1.
        batch_steps: If given, a batch has as many episodes as it takes to play about this many environment steps,
            judged by the mean length in the batch before (``batch_size`` is the least, 64 times that the most), so
            that the long episodes of an unskilled policy do not use up the time.
        update_steps: If given, learn online, from one continuing stream, with an update every so many steps, instead of
            from batches of whole episodes: for tasks that go on (section 3.4.4). See ``online.py``.
        gamma: Discount factor of the returns R_t, in (0, 1].
        optimizer: Name of a class in ``torch.optim``: SGD, Adam, RMSprop, ...
        learning_rate: Step size alpha of the optimiser.
        learning_rate_halflife: Updates after which alpha has fallen to half; None keeps it.
        optimizer_options: Other arguments of the optimiser, such as ``{momentum: 0.9}``.
        gradient_length: Length that the gradient is normalised to before the step; None leaves it as it is.
        baseline: Kind of the baseline b, alone or with its settings, ``{kind: history, cells: 32}`` (section 3.3.2).
            ``constant`` (``episodes``): the mean of all R_t of the last episodes.
            ``shared`` (``weight``): a linear read-out of the policy's own memory, which it teaches to hold what returns
            depend on, long before the policy can profit from it.
            ``history`` (``cells``, ``optimizer``, ``learning_rate``, ``optimizer_options``, ``steps``): a second LSTM,
            which sees the same history.
            ``quadratic``: a quadratic function of the observation, of use at once, without memory.
            Each is described in its file in ``dpsearch/algos/baselines``.
        trace: Lambda of the generalised advantage estimate (Schulman et al., ICLR 2016), in [0, 1]: 1 weights
            eligibilities by R_t - b as in section 3.3.2; less trusts the baseline for what comes later, which is less
            noisy and, as far as the baseline is wrong, biased.
        normalise_advantages: Divide advantages by their running root mean square, so that learning rate and
            ``entropy_bonus`` mean the same on every task. A batch is not scaled by itself alone: that would make rare
            disasters count for little.
        advantage_memory: Decay of the running scale of advantages from batch to batch; 1 averages over all batches.
            With less, a policy that has learned to avoid disasters unlearns it over trifles, which come to look large.
        entropy_bonus: Weight of the entropy, summed over an episode's steps: keeps a policy from settling too early.
        entropy_halflife: Updates after which the bonus has fallen to half; None keeps it.
        variance_scaled: Multiply a Gaussian policy's eligibilities by sigma^2 (section 3.4.1; Williams 1992): they stay
            finite as sigma goes to 0.
        natural_step: If given, the gradient is replaced by the natural one (see ``natural_gradient.py``), of the length
            that, at a ``learning_rate`` of 1, makes the actions' distribution at an average step differ by this many
            nats of KL divergence, however the weights are scaled: no more than can be judged from one batch.
        damping: Number added to the diagonal of the Fisher information matrix of the natural gradient.
        mirror: Learn also from the mirror image of each episode, for tasks that are alike on the left and on the right.
            Natural steps of a Gaussian policy, and baselines, then fit images too. The environment must declare by
            which signs a mirror multiplies its observations and actions, as an attribute ``mirror_signs``: a 1 or -1
            for each number of the flat observation, then for each of the action. See ``mirror.py``.
        restart_episodes: If given, learning begins again from other random weights whenever so many episodes did not
            improve the mean return: on some tasks most starts lead to a policy that is hard to improve.
        restart_gain: Share of its size by which the mean discounted return has to rise within ``restart_episodes``.
    """

    batch_size: int = 20
    batch_steps: int | None = None
    update_steps: int | None = None
    gamma: float = 0.98
    optimizer: str = "SGD"
    learning_rate: float = 1.0
    learning_rate_halflife: float | None = None
    optimizer_options: dict[str, Any] = field(default_factory=dict)
    gradient_length: float | None = 0.3
    baseline: Any = field(default_factory=lambda: {"kind": "constant"})  # a BaselineConfig once checked
    trace: float = 1.0
    normalise_advantages: bool = False
    advantage_memory: float = 0.98
    entropy_bonus: float = 0.0
    entropy_halflife: float | None = None
    variance_scaled: bool = False
    natural_step: float | None = None
    damping: float = 0.01
    mirror: bool = False
    restart_episodes: int | None = None
    restart_gain: float = 0.0

    def __post_init__(self) -> None:
        """Raise a ValueError that names the setting if a value is out of range."""
        self.baseline = baseline_config(self.baseline, DEFAULTS)
        require(
            self,
            {
                "batch_size": (is_whole(self.batch_size, 1), "a whole number, at least 1"),
                "batch_steps": (self.batch_steps is None or self.batch_steps >= 1, "at least 1 or null"),
                "update_steps": (
                    self.update_steps is None or (self.update_steps >= 1 and self.batch_steps is None),
                    "at least 1 or null; batch_steps, which is for batches of whole episodes, must be null beside it",
                ),
                "gamma": (0.0 < self.gamma <= 1.0, "in (0, 1]"),
                "optimizer": (self.optimizer in OPTIMIZERS, f"one of {', '.join(OPTIMIZERS)}"),
                "learning_rate": (0.0 < self.learning_rate < math.inf, "positive and finite"),
                "learning_rate_halflife": (positive_or_none(self.learning_rate_halflife), FINITE),
                "gradient_length": (positive_or_none(self.gradient_length), FINITE),
                "trace": (0.0 <= self.trace <= 1.0, "in [0, 1]"),
                "advantage_memory": (0.0 < self.advantage_memory <= 1.0, "in (0, 1]"),
                "entropy_bonus": (0.0 <= self.entropy_bonus < math.inf, "0 or more"),
                "entropy_halflife": (positive_or_none(self.entropy_halflife), FINITE),
                "damping": (0.0 <= self.damping < math.inf, "0 or more"),
                "restart_gain": (0.0 <= self.restart_gain < math.inf, "0 or more"),
                **self._of_variations(),
            },
        )

    def _of_variations(self) -> dict[str, tuple[bool, str]]:
        """Checks of the settings that exclude one another."""
        alone = self.gradient_length is None and self.optimizer == "SGD" and not self.variance_scaled
        carried = self.update_steps is not None and self.baseline.kind == "history"
        return {
            "natural_step": (
                self.natural_step is None or (self.natural_step > 0.0 and alone and self.baseline.kind != "shared"),
                "positive or null; with it, gradient_length must be null, optimizer SGD, baseline not shared and "
                "variance_scaled false; natural_step=null takes plain gradients",
            ),
            "restart_episodes": (
                self.restart_episodes is None or (self.restart_episodes >= 1 and self.update_steps is None),
                "at least 1, and without update_steps, or null",
            ),
            "mirror": (
                self.mirror is False or (self.mirror is True and self.natural_step is not None and not carried),
                "true or false; false without a natural_step, and with a history baseline of a stream, which carries "
                "one memory on",
            ),
        }

    def check_policy(self, policy: RecurrentPolicy) -> None:
        """Raise a ValueError if the policy has no gradient, or not the one asked for."""
        head = policy.head
        if head.draws == 0:
            raise ValueError(f"policy must sample its actions, this one's head is {type(head).__name__}")
        if self.variance_scaled and not head.deviations:
            raise ValueError(
                f"variance_scaled must be false: it needs a Gaussian policy, this one's head is {type(head).__name__}"
            )
