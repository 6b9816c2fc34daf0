"""RPG, recurrent policy gradients: chapter 3 of the thesis.

Episodes are played with the current policy; then the eligibilities of its outputs, each weighted by how much better
than the baseline the return from that step on was, are backpropagated through time (section 3.3.3):

    grad J  ~  1/N  sum_n sum_t  grad log pi(a_t | h_t) (R_t - b)                                (section 3.3.2)

The one thing to understand: only the outputs are stochastic, so autograd through one fused ``nn.LSTM`` call over the
whole batch gives the exact gradient of that sum, memory included.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dpsearch.algos.base import Algorithm, Env, Metrics
from dpsearch.policies import PolicyConfig, RecurrentPolicy
from dpsearch.rollout import Episodes


@dataclass
class RPGConfig:
    """How RPG learns. The defaults are the thesis's best for the T-maze (section 3.4.2).

    Attributes:
        batch_size: Episodes N of one update; the thesis's standard elsewhere is 1.
        gamma: Discount factor of the returns R_t, in (0, 1].
        optimizer: Name of a class in ``torch.optim``.
        learning_rate: Its step size alpha.
        optimizer_options: Its other arguments, such as ``{momentum: 0.9}``.
        gradient_length: Length that the gradient is normalised to before the step; None leaves it as it is.
        baseline_episodes: Episodes in the moving average of returns that is the baseline b; 0 for none.
        variance_scaled: Scale the eligibilities of a Gaussian policy by sigma^2 (Williams 1992), so that they stay
            finite as sigma goes to 0.
    """

    batch_size: int = 20
    gamma: float = 0.98
    optimizer: str = "SGD"
    learning_rate: float = 1.0
    optimizer_options: dict[str, Any] = field(default_factory=dict)
    gradient_length: float | None = 0.3
    baseline_episodes: int = 100
    variance_scaled: bool = False

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field if a value is out of range."""
        accepted = {
            "batch_size": (self.batch_size >= 1, "at least 1"),
            "gamma": (0.0 < self.gamma <= 1.0, "in (0, 1]"),
            "learning_rate": (self.learning_rate > 0.0, "positive"),
            "gradient_length": (self.gradient_length is None or self.gradient_length > 0.0, "positive or null"),
            "baseline_episodes": (self.baseline_episodes >= 0, "0 or more"),
            "optimizer": (isinstance(getattr(torch.optim, self.optimizer, None), type), "a class of torch.optim"),
        }
        for name, (fits, what) in accepted.items():
            if not fits:
                raise ValueError(f"{name} must be {what}, got {getattr(self, name)!r}")


class RPG(Algorithm[RPGConfig]):
    """Recurrent policy gradients; see ``Algorithm`` for the arguments."""

    name = "rpg"
    config_type = RPGConfig

    def __init__(
        self,
        env: Env,
        config: RPGConfig | None = None,
        *,
        policy: PolicyConfig | RecurrentPolicy | None = None,
        seed: int = 0,
        threads: int = 1,
        env_kwargs: dict[str, Any] | None = None,
        **overrides: Any,
    ) -> None:
        super().__init__(
            env, config, policy=policy, seed=seed, threads=threads, env_kwargs=env_kwargs, **overrides
        )
        self.parameters = self.policy.free_parameters()
        make_optimizer = getattr(torch.optim, self.config.optimizer)
        self.optimizer: torch.optim.Optimizer = make_optimizer(
            self.parameters, lr=self.config.learning_rate, **self.config.optimizer_options
        )
        self.baseline_returns: deque[float] = deque(maxlen=self.config.baseline_episodes)

    def update(self) -> Metrics:
        """Play a batch, ascend its gradient (section 3.3.3), and say how it went."""
        start = perf_counter()
        episodes = self.play_batch(self.config.batch_size)
        sampled = perf_counter()
        baseline = self.baseline()
        returns = episodes.returns_to_go(self.config.gamma)  # R_t, (T, N), section 2.1
        self.baseline_returns.extend(returns[0].tolist())
        self.optimizer.zero_grad()
        loss, entropy = self.loss(episodes, returns - baseline)
        loss.backward()  # type: ignore[no-untyped-call]
        length = self._normalise_gradient()
        backpropagated = perf_counter()
        self.optimizer.step()
        self.updates += 1
        return {
            "return": float(episodes.returns.mean()),
            "episode_length": episodes.steps / len(episodes),
            "gradient_norm": length,
            "entropy": entropy,
            "baseline": baseline,
            "time/sample": sampled - start,
            "time/gradient": backpropagated - sampled,
            "time/step": perf_counter() - backpropagated,
        }

    def baseline(self) -> float:
        """b: the mean discounted return of the last episodes before this batch, so that it cannot bias the gradient."""
        return float(np.mean(self.baseline_returns)) if self.baseline_returns else 0.0

    def loss(self, episodes: Episodes, advantages: np.ndarray) -> tuple[Tensor, float]:
        """Minus the weighted log-likelihood whose gradient is section 3.3.2's, and the policy's mean entropy."""
        mask = torch.from_numpy(episodes.mask)  # (T, N)
        weights = torch.from_numpy(advantages.astype(np.float32)) * mask
        outputs, _ = self.policy(torch.from_numpy(episodes.observations))  # (T, N, K): one fused call
        log_prob = self.policy.head.log_prob(outputs, torch.from_numpy(episodes.actions))  # (T, N)
        if self.config.variance_scaled:
            weights = weights * self.policy.head.variance(outputs)
        with torch.no_grad():
            entropy = (self.policy.head.entropy(outputs) * mask).sum() / mask.sum()
        return -(log_prob * weights).sum() / len(episodes), float(entropy)

    def _normalise_gradient(self) -> float:
        """Scale the gradient to the length asked for; returns the length it had."""
        gradients = [p.grad for p in self.parameters if p.grad is not None]
        length = float(torch.nn.utils.get_total_norm(gradients))
        if not np.isfinite(length):
            raise FloatingPointError(
                f"the gradient of update {self.updates} is not finite: lower learning_rate or gradient_length"
            )
        if self.config.gradient_length is not None and length > 0.0:
            torch._foreach_mul_(gradients, self.config.gradient_length / length)
        return length

    def state_dict(self) -> dict[str, Any]:
        """All that the rest of the run depends on."""
        return {
            **super().state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "baseline_returns": list(self.baseline_returns),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on exactly where ``state_dict`` was taken."""
        super().load_state_dict(state)
        self.optimizer.load_state_dict(state["optimizer"])
        self.baseline_returns = deque(state["baseline_returns"], maxlen=self.config.baseline_episodes)
