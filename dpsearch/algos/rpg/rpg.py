"""RPG, recurrent policy gradients: chapter 3 of the thesis.

The current policy plays episodes. The eligibilities of its outputs, each weighted by how much better than the baseline
the return from that step on was, are then backpropagated through time (section 3.3.3):

    grad J  ~  1/N  sum_n sum_t  grad log pi(a_t | h_t) (R_t - b)                                (section 3.3.2)

The one thing to understand: only the outputs are stochastic, so autograd through the unrolled network gives the exact
gradient of that sum, memory included.

Read on in ``config.py`` (the settings), ``gradient.py`` (eligibilities), ``../baselines`` (b), ``../advantages.py``
(R_t - b over time) and ``source.py`` (batches). Off by default: ``online.py``, ``natural_gradient.py``, ``mirror.py``
and ``restarts.py``.
"""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from dpsearch.algos.advantages import RunningScale, generalised_advantages
from dpsearch.algos.base import BASELINE, WEIGHTS, Algorithm, Env, Metrics
from dpsearch.algos.baselines import make_baseline
from dpsearch.algos.optimizers import make_optimizer, normalise_gradient, set_learning_rate
from dpsearch.algos.rpg.config import RPGConfig
from dpsearch.algos.rpg.gradient import eligibilities
from dpsearch.algos.rpg.mirror import Mirror
from dpsearch.algos.rpg.natural_gradient import backpropagate_naturally
from dpsearch.algos.rpg.online import Online
from dpsearch.algos.rpg.restarts import Progress
from dpsearch.algos.rpg.source import Batches, Source
from dpsearch.algos.unroll import unroll
from dpsearch.kernels.philox import stream_key
from dpsearch.rollout import Episodes


class RPG(Algorithm[RPGConfig]):
    """Recurrent policy gradients; see ``Algorithm`` for the arguments."""

    name = "rpg"
    config_type = RPGConfig
    parts = (*Algorithm.parts, "source", "baseline", "optimizer", "advantage_scale", "progress", "mirror")
    values = (*Algorithm.values, "starts", "first_update")

    def __init__(self, env: Env, config: RPGConfig | None = None, **options: Any) -> None:
        super().__init__(env, config, **options)
        self.config.check_policy(self.policy)
        self.mirror = Mirror(self.rollouts.mirror_signs, self.policy) if self.config.mirror else None
        self.starts = 0
        self._begin()

    def _begin(self) -> None:
        """Start to learn from the present weights."""
        config, self.starts, self.first_update = self.config, self.starts + 1, self.updates
        self.baseline = make_baseline(config.baseline, self.policy, self._weights_seed(BASELINE))
        self.parameters = [*self.policy.free_parameters(), *self.baseline.parameters()]
        self.optimizer = make_optimizer(
            config.optimizer, self.parameters, config.learning_rate, config.optimizer_options
        )
        self.advantage_scale = RunningScale(config.advantage_memory)
        self.progress = Progress(config.restart_episodes, config.restart_gain)
        self.source: Source = Batches(self) if config.update_steps is None else Online(self)

    def _weights_seed(self, purpose: int) -> int:
        """Seed of the initial weights, other ones for each start; 63 bits, as torch takes."""
        key = stream_key(self.seed, purpose)
        return (key if self.starts == 1 else stream_key(key, self.starts)) >> 1

    def update(self) -> Metrics:
        """Play, backpropagate, and take one step along the gradient (section 3.3.3)."""
        start, config = perf_counter(), self.config
        if self.progress.stalled and not self.solved:
            self._begin()
            self.recent_returns.clear()
            self.policy.initialise(self._weights_seed(WEIGHTS))
        episodes = self.source.play()
        sampled = perf_counter()
        for parameter in self.parameters:
            parameter.grad = None  # optimizer.zero_grad() takes ten times longer
        judged = self.backpropagate(episodes)
        length = normalise_gradient(self.parameters, config.gradient_length, self.updates)
        backpropagated = perf_counter()
        if config.learning_rate_halflife is not None:
            set_learning_rate(self.optimizer, config.learning_rate * self._faded(config.learning_rate_halflife))
        self.optimizer.step()
        self.updates += 1
        times = {"time/sample": sampled - start, "time/gradient": backpropagated - sampled}
        times["time/step"] = perf_counter() - backpropagated
        return {**self.source.metrics(episodes), "gradient_norm": length, **judged, **times}

    def backpropagate(self, episodes: Episodes) -> Metrics:
        """Make minus section 3.3.2's gradient, or minus the natural step, the ``grad`` of parameters that have none.

        The baseline learns from the episodes, and ``progress`` notes their returns.

        Returns:
            ``entropy``, the policy's mean in nats, and ``explained_variance``, the share of R_t's that b predicts.
        """
        config, played = self.config, len(episodes)
        if self.mirror is not None:
            episodes = self.mirror.doubled(episodes)
        n = episodes.count  # len(episodes); 1 for the pieces of a stream
        features = unroll(self.policy, episodes)  # (T, N, H), the memory of h_t
        ahead = self.baseline.expected(episodes, features) if episodes.goes_on else None
        returns = episodes.returns_to_go(config.gamma, ahead)  # R_t, (T, N), section 2.1
        baseline, loss = self.baseline(episodes, features, returns)  # b, (T, N), section 3.3.2
        surprises: NDArray[np.float32] = returns - baseline
        if episodes.padded:
            surprises *= episodes.mask
        self.progress.note(returns[0, :played])
        advantages = generalised_advantages(episodes, surprises, config.gamma, config.trace)  # (T, N)
        if config.normalise_advantages:
            self.advantage_scale.note(advantages[episodes.mask])
            scale = self.advantage_scale.value
            advantages, loss = advantages / scale, None if loss is None else loss / scale**2
        eligible = eligibilities(
            *(self.policy, episodes, features, advantages / np.float32(-n)),  # minus, as optimisers descend
            bonus=config.entropy_bonus * self._faded(config.entropy_halflife) / -n,
            at_outputs=config.natural_step is not None,
            variance_scaled=config.variance_scaled,
        )
        if self.mirror is not None:
            self.mirror.reflect(*eligible.gradients)
        if config.natural_step is None:
            eligible.backward(None if loss is None else loss / n)  # through time, section 3.3.3
        else:
            divergence = config.natural_step * self.source.caution(advantages[episodes.mask])
            backpropagate_naturally(self.policy, episodes, eligible, config.damping, divergence)
        if isinstance(baseline, float):  # a constant predicts nothing of the variance
            return {"entropy": episodes.moments(eligible.entropy)[0][0], "explained_variance": 0.0}
        (entropy, _), (_, variance), (_, left) = episodes.moments(eligible.entropy, returns, surprises)
        return {"entropy": entropy, "explained_variance": 1.0 - left / variance if variance > 0.0 else 0.0}

    def _faded(self, halflife: float | None) -> float:
        """The part that is left at this update of what halves every ``halflife`` updates."""
        return 1.0 if halflife is None else 0.5 ** ((self.updates - self.first_update) / halflife)

    @property
    @override
    def headline(self) -> str:
        return self.source.headline or super().headline

    @override
    def close(self) -> None:
        super().close()
        self.source.close()
