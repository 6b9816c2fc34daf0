"""RPG, recurrent policy gradients: chapter 3 of the thesis.

Episodes are played with the current policy; then the eligibilities of its outputs, each weighted by how much better
than the baseline the return from that step on was, are backpropagated through time (section 3.3.3):

    grad J  ~  1/N  sum_n sum_t  grad log pi(a_t | h_t) (R_t - b)                                (section 3.3.2)

The one thing to understand: only the outputs are stochastic, so autograd through a fused ``nn.LSTM`` call over the
whole batch, or a few for episodes of unlike length, gives the exact gradient of that sum, memory included. With
``update_steps`` it is cut off where an update is; with ``natural_step`` it is turned before the step.
"""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from typing_extensions import override

from dpsearch.algos.advantages import RunningScale, generalised_advantages
from dpsearch.algos.base import BASELINE, WEIGHTS, Algorithm, Env, Metrics
from dpsearch.algos.baselines.make import make_baseline
from dpsearch.algos.optimizers import make_optimizer, normalise_gradient
from dpsearch.algos.rpg.config import RPGConfig
from dpsearch.algos.rpg.mirror import Mirror
from dpsearch.algos.rpg.natural_gradient import Unroll, natural_step
from dpsearch.algos.rpg.restarts import Progress
from dpsearch.kernels.philox import stream_key
from dpsearch.policies import Categorical, RecurrentPolicy
from dpsearch.rollout import Episodes, Pieces, Stream


class RPG(Algorithm[RPGConfig]):
    """Recurrent policy gradients; see ``Algorithm`` for the arguments."""

    name = "rpg"
    config_type = RPGConfig

    def __init__(self, env: Env, config: RPGConfig | None = None, **options: Any) -> None:
        super().__init__(env, config, **options)
        if self.config.variance_scaled:
            head = self.policy.head  # refused now, not when it learns
            head.scaled_eligibilities(torch.zeros(1, head.n_outputs), torch.zeros(1, head.action_size), torch.ones(1))
        self.mirror = None if self.config.mirror is None else Mirror(self.config.mirror, self.policy)
        self.stream = None if self.config.update_steps is None else Stream(self.rollouts, self.training_key)
        self.starts = 0
        self._begin()

    def _begin(self) -> None:
        """From the weights as they are, with nothing remembered of what came before."""
        self.starts += 1
        self._first_update = self.updates
        self.progress = Progress(self.config.restart_episodes, self.config.restart_gain)
        self.baseline = make_baseline(self.config, self.policy, self._weights_seed(BASELINE))
        self.parameters = [*self.policy.free_parameters(), *self.baseline.parameters()]
        self.optimizer = make_optimizer(
            self.config.optimizer, self.parameters, self.config.learning_rate, self.config.optimizer_options
        )
        self.batch_size = self.config.batch_size
        self._reward = 0.0  # of a step of the stream, in the last update
        self.advantage_scale = RunningScale(self.config.advantage_memory)

    def _weights_seed(self, purpose: int) -> int:
        """Of the weights of this start, other ones for each; 63 bits, as torch takes."""
        key = stream_key(self.seed, purpose)
        return (key if self.starts == 1 else stream_key(key, self.starts)) >> 1

    def update(self) -> Metrics:
        """Play a batch, or the next steps of the stream, ascend the gradient (section 3.3.3), and say how it went."""
        start = perf_counter()
        if self.progress.stalled and not self.solved:
            self._begin()
            self.recent_returns.clear()
            self.policy.initialise(self._weights_seed(WEIGHTS))
        episodes = self.play_batch(self.batch_size) if self.stream is None else self._play_on(self.stream)
        sampled = perf_counter()
        for parameter in self.parameters:
            parameter.grad = None  # optimizer.zero_grad() takes ten times longer
        judged = self.backpropagate(episodes)
        length = normalise_gradient(self.parameters, self.config.gradient_length, self.updates)
        backpropagated = perf_counter()
        if self.config.learning_rate_halflife is not None:
            for group in self.optimizer.param_groups:
                group["lr"] = self.config.learning_rate * self._halved(self.config.learning_rate_halflife)
        self.optimizer.step()
        self.updates += 1
        if self.config.batch_steps is not None:
            fitting = round(self.config.batch_steps * len(episodes) / episodes.steps)
            self.batch_size = min(max(fitting, self.config.batch_size), 64 * self.config.batch_size)
        return {
            **self._played(episodes),
            "gradient_norm": length,
            **judged,
            "time/sample": sampled - start,
            "time/gradient": backpropagated - sampled,
            "time/step": perf_counter() - backpropagated,
        }

    def _played(self, episodes: Episodes) -> Metrics:
        if self.stream is None:
            n = len(episodes)
            return {"return": float(episodes.returns.sum()) / n, "episode_length": episodes.steps / n}
        self._reward = float(episodes.returns.sum()) / episodes.steps
        return {"reward": self._reward}

    @property
    @override
    def headline(self) -> str:
        return super().headline if self.stream is None else f"reward {self._reward:,.4g} a step"

    def _play_on(self, stream: Stream) -> Pieces:
        """The next steps of the stream, counted."""
        assert self.config.update_steps is not None
        pieces = stream.play(self.policy, self.config.update_steps)
        self.episodes += len(pieces.finished)
        self.env_steps += pieces.steps
        self.recent_returns.extend(pieces.finished.tolist())
        return pieces

    def backpropagate(self, episodes: Episodes) -> Metrics:
        """Make minus section 3.3.2's gradient, or minus the natural step, the parameters' ``grad``, None before.

        The baseline learns from the episodes, and ``progress`` notes their returns.

        Returns:
            The mean ``entropy`` in nats, and the ``explained_variance``: what part of the R_t's the baseline foresaw;
            both over images too, if there are any.
        """
        config, played = self.config, len(episodes)
        if self.mirror is not None:
            episodes = self.mirror.doubled(episodes)
        count = len(episodes) if self.stream is None else 1  # the pieces of a stream are one episode
        observations, actions = torch.from_numpy(episodes.observations), torch.from_numpy(episodes.actions)
        state = _memory(episodes)

        def outputs(other: RecurrentPolicy) -> Tensor:
            return other.distribution(other.unroll(observations, actions, episodes.seen, state), actions, state)

        features = self.policy.unroll(observations, actions, episodes.seen, state)  # (T, N, H), a fused call or a few
        foreseen = None if self.stream is None else self.baseline.expected(episodes, features)
        returns = episodes.returns_to_go(config.gamma, foreseen)  # R_t, (T, N), section 2.1
        baseline, loss = self.baseline(episodes, features, returns)
        surprises: NDArray[np.float32] = returns - baseline
        if episodes.padded:
            surprises *= episodes.mask
        self.progress.note(returns[0, :played])
        advantages = generalised_advantages(episodes, surprises, config.gamma, config.trace)  # (T, N)
        if config.normalise_advantages:
            self.advantage_scale.note(advantages[episodes.mask])
            scale = self.advantage_scale.value
            advantages = advantages / scale
            loss = None if loss is None else loss / scale**2
        weights: NDArray[np.float32] = advantages / np.float32(-count)  # minus, as optimisers descend
        end, slopes, entropy = self._eligible(episodes, features, weights, count)
        if config.natural_step is not None:
            divergence = config.natural_step
            if self.stream is not None and config.normalise_advantages:  # where all goes as expected, little is learned
                divergence *= min(float(np.square(advantages[episodes.mask]).mean()), 1.0)
            self._ascend_naturally(end, slopes, outputs, episodes.mask, divergence)
        elif loss is None:
            end.backward(slopes)  # through time, section 3.3.3
        else:
            torch.autograd.backward((end, loss / count), (slopes, None))
        if isinstance(baseline, float):  # which explains nothing
            return {"entropy": episodes.moments(entropy)[0][0], "explained_variance": 0.0}
        (entropy_mean, _), (_, spread), (_, left) = episodes.moments(entropy, returns, surprises)
        return {"entropy": entropy_mean, "explained_variance": 1.0 - left / spread if spread > 0.0 else 0.0}

    def _eligible(
        self, episodes: Episodes, features: Tensor, weights: NDArray[np.float32], count: int
    ) -> tuple[Tensor, Tensor, NDArray[np.float32]]:
        """From where to backpropagate what: minus the eligibilities, each weighted, and minus the entropy bonus.

        Args:
            episodes: N of them.
            features: What the policy remembered, ``(T, N, H)``.
            weights: Minus those of the eligibilities, ``(T, N)``.
            count: As how many episodes they count.

        Returns:
            The policy's outputs ``(T, N, K)``, or the features if the read-out's ``grad`` is set already; the loss's
            derivatives by them; the entropy ``(T, N)``.
        """
        policy, head, config = self.policy, self.policy.head, self.config
        bonus = None
        if config.entropy_bonus > 0.0:
            bonus = episodes.mask * np.float32(config.entropy_bonus * self._halved(config.entropy_halflife) / -count)
        if isinstance(head, Categorical) and config.natural_step is None and not config.variance_scaled:
            slopes, entropy = head.backpropagate(policy.readout_layer, features, episodes.actions, weights, bonus)
            return features, slopes, entropy
        actions = torch.from_numpy(episodes.actions)
        outputs = policy.distribution(features, actions, _memory(episodes))  # (T, N, K)
        eligible = head.scaled_eligibilities if config.variance_scaled else head.eligibilities
        seen = outputs.detach()
        if episodes.padded:  # what the policy would do there must not matter
            seen = torch.where(torch.from_numpy(episodes.mask)[..., None], seen, 0.0)
        extra = None if bonus is None else torch.from_numpy(bonus)
        slopes, entropies = eligible(seen, actions, torch.from_numpy(weights), extra)
        if self.mirror is not None:
            self.mirror.reflect(slopes)
        return outputs, slopes, entropies.numpy()

    def _ascend_naturally(
        self, outputs: Tensor, eligibilities: Tensor, unroll: Unroll, mask: NDArray[np.bool_], divergence: float
    ) -> None:
        """Set the parameters' ``grad`` to minus the natural step that belongs to eligibilities ``(T, N, K)``."""
        gradient = [-part for part in torch.autograd.grad(outputs, self.parameters, eligibilities, retain_graph=True)]
        steps = natural_step(self.policy, gradient, outputs, unroll, mask, self.config.damping, divergence)
        for parameter, step in zip(self.parameters, steps, strict=True):
            parameter.grad = -step  # optimisers descend

    def _halved(self, halflife: float | None) -> float:
        """What is left of something at this update."""
        return 1.0 if halflife is None else 0.5 ** ((self.updates - self._first_update) / halflife)

    @override
    def close(self) -> None:
        super().close()
        if self.stream is not None:
            self.stream.close()

    def state_dict(self) -> dict[str, Any]:
        """All that the rest of the run depends on."""
        return {
            **super().state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "baseline": self.baseline.state_dict(),
            "batch_size": self.batch_size,
            "advantage_scale": self.advantage_scale.state_dict(),
            "start": [self.starts, self._first_update],
            "progress": self.progress.state_dict(),
            "mirror": None if self.mirror is None else self.mirror.state_dict(),
            "stream": None if self.stream is None else self.stream.state_dict(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on exactly where ``state_dict`` was taken."""
        super().load_state_dict(state)
        self.optimizer.load_state_dict(state["optimizer"])
        self.baseline.load_state_dict(state["baseline"])
        self.batch_size = state["batch_size"]
        self.advantage_scale.load_state_dict(state["advantage_scale"])
        self.starts, self._first_update = state["start"]
        self.progress.load_state_dict(state["progress"])
        if self.mirror is not None:
            self.mirror.load_state_dict(state["mirror"])
        if self.stream is not None:
            self.stream.load_state_dict(state["stream"])


def _memory(episodes: Episodes) -> Tensor | None:
    """Before the first step, ``(N, state_size)``; None for none."""
    return None if episodes.state is None else torch.from_numpy(episodes.state)
