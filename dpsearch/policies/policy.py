"""The policy: a core that remembers, a linear read-out, and a head that makes it a distribution (section 3.3.3).

Only the outputs are stochastic; the memory is a deterministic function of the history, so its gradient is plain
backpropagation through time, which ``torch.nn.LSTM`` does in one fused call for a whole batch of episodes.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal, cast

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from dpsearch.policies.buckets import run_in_buckets
from dpsearch.policies.compiled import CompiledPolicy, compiled_policy
from dpsearch.policies.heads import Gaussian, Head
from dpsearch.policies.observations import observation_size
from dpsearch.policies.spaces import head_for

Core = Literal["lstm", "rnn", "none"]


@dataclass
class PolicyConfig:
    """The architecture of a policy and its initial weights; see ``RecurrentPolicy`` for what each means."""

    core: str = "lstm"
    hidden_size: int = 10
    bias: bool = True
    init_range: float = 0.01
    forget_bias: float = 0.0
    input_bias: float = 0.0
    readout: bool = True
    previous_action: bool = False
    init_std: float | None = None
    noise_memory: float = 0.0


class RecurrentPolicy(nn.Module):
    """Maps histories to distributions over actions.

    Args:
        observation_size: Length O of a flat observation.
        head: The distribution over actions.
        core: ``"lstm"`` (torch.nn.LSTM), ``"rnn"`` (Elman's, tanh) or ``"none"`` (a tanh layer without memory).
        hidden_size: Cells H of the core; the thesis uses 10.
        bias: Whether core and read-out have biases.
        init_range: Weights and biases start uniform in [-init_range, init_range] (thesis: 0.01).
        forget_bias: Added to the initial biases of an LSTM's forget gates. A cell keeps sigmoid(forget_bias) of its
            content from one step to the next: half with biases near 0, 99.97% with 8.
        input_bias: Added to the initial biases of its input gates; a negative one keeps cells from filling up with
            what is seen at every step.
        readout: False leaves the linear read-out away: the first cells' activations are the outputs, as in a fully
            recurrent network without a layer of its own for the output.
        previous_action: The policy also sees its previous action, one-hot if discrete, zeros at first. A policy that
            samples its actions cannot otherwise know which it took.
        init_std: The standard deviation that a Gaussian policy starts with, in (0, 1); None for one half, since all
            weights are small.
        noise_memory: What part of a Gaussian policy's noise is left in its next action, in [0, 1), where the standard
            deviation sigma is that of what is added: noise that lasts, and is sigma / sqrt(1 - noise_memory^2) on the
            whole, gives pushes that move what is heavy, where those of independent noise cancel (Wawrzynski, IJMLC
            2015). The policy remembers its noise, so that actions are still Gaussian given the history.
        seed: Seed of the initial weights.
    """

    def __init__(
        self,
        observation_size: int,
        head: Head,
        *,
        core: str = "lstm",
        hidden_size: int = 10,
        bias: bool = True,
        init_range: float = 0.01,
        forget_bias: float = 0.0,
        input_bias: float = 0.0,
        readout: bool = True,
        previous_action: bool = False,
        init_std: float | None = None,
        noise_memory: float = 0.0,
        seed: int = 0,
    ) -> None:
        if core not in ("lstm", "rnn", "none"):
            raise ValueError(f"core must be 'lstm', 'rnn' or 'none', got {core!r}")
        for name, size in (("observation_size", observation_size), ("hidden_size", hidden_size)):
            if size < 1:
                raise ValueError(f"{name} must be positive, got {size}")
        if not (math.isfinite(init_range) and init_range >= 0.0):
            raise ValueError(f"init_range must be finite and at least 0, got {init_range}")
        for name, added in (("forget_bias", forget_bias), ("input_bias", input_bias)):
            if not math.isfinite(added):
                raise ValueError(f"{name} must be finite, got {added}")
        if (forget_bias or input_bias) and (core != "lstm" or not bias):
            raise ValueError(f"forget_bias and input_bias need an LSTM with biases, got core {core!r}, bias {bias}")
        if init_std is not None and not (isinstance(head, Gaussian) and bias and readout and 0.0 < init_std < 1.0):
            raise ValueError(f"init_std must be in (0, 1), of a Gaussian policy with biases, got {init_std}")
        if noise_memory and not (isinstance(head, Gaussian) and readout and 0.0 < noise_memory < 1.0):
            raise ValueError(f"noise_memory must be 0, or below 1 and of a Gaussian policy, got {noise_memory}")
        if not readout and hidden_size < head.n_outputs:
            raise ValueError(f"readout must be true if hidden_size is below the {head.n_outputs} outputs needed")
        super().__init__()
        self.observation_size = observation_size
        self.hidden_size = hidden_size
        self.head = head
        self.core_type = cast(Core, core)
        self.bias = bias
        self._config = PolicyConfig(
            core,
            hidden_size,
            bias,
            init_range,
            forget_bias,
            input_bias,
            readout,
            previous_action,
            init_std,
            noise_memory,
        )
        self.echo_size = head.echo_size if previous_action else 0
        self.noise_memory, self.noise_size = noise_memory, head.action_size if noise_memory else 0
        inputs = observation_size + self.echo_size
        self.core: nn.LSTM | nn.RNN | nn.Linear
        if core == "lstm":
            self.core = nn.LSTM(inputs, hidden_size, bias=bias)
        elif core == "rnn":
            self.core = nn.RNN(inputs, hidden_size, bias=bias)
        else:
            self.core = nn.Linear(inputs, hidden_size, bias=bias)
        self.readout = nn.Linear(hidden_size, head.n_outputs, bias=bias)
        if isinstance(self.core, nn.LSTM | nn.RNN) and bias:
            # torch adds two bias vectors; the second is redundant, so it stays 0 and is not a free parameter
            redundant = self.core.get_parameter("bias_hh_l0")
            nn.init.zeros_(redundant)
            redundant.requires_grad_(False)
        self.has_readout = readout
        if not readout:
            for fixed in self.readout.parameters():
                fixed.requires_grad_(False)
                nn.init.zeros_(fixed)
            nn.init.eye_(self.readout.weight)
        # found once: they are asked for at every update
        self._free = [p for p in self.parameters() if p.requires_grad]
        self._places: list[int] = []  # where the free parameters were when they were last looked at through _views
        self._views: list[NDArray[Any]] = []
        self._core_weights: list[Tensor] = list(self.core.parameters())
        self.readout_layer = self.readout.weight, self.readout.bias if bias else None  # as ``Categorical`` takes it
        self.initialise(seed)

    @classmethod
    def for_spaces(
        cls,
        observation_space: gym.Space[Any],
        action_space: gym.Space[Any],
        config: PolicyConfig | None = None,
        *,
        deterministic: bool = False,
        seed: int = 0,
    ) -> RecurrentPolicy:
        """A policy that fits an environment.

        Args:
            observation_space: Of a single environment.
            action_space: Of a single environment; Discrete and MultiDiscrete get a softmax head, a Box a Gaussian.
            config: Architecture; the thesis's 10-cell LSTM if None.
            deterministic: Give a Box a deterministic head instead, for black-box search.
            seed: Seed of the initial weights.

        Raises:
            UnsupportedSpaceError: If a space is of a kind that no policy can handle.
        """
        config = config or PolicyConfig()
        head = head_for(action_space, deterministic=deterministic, squash=config.readout)
        return cls(observation_size(observation_space), head, seed=seed, **vars(config))

    def initialise(self, seed: int) -> None:
        """Draw the free parameters anew.

        Args:
            seed: In [0, 2**63).
        """
        config, generator = self._config, torch.Generator().manual_seed(seed)
        for parameter in self.free_parameters():
            nn.init.uniform_(parameter, -config.init_range, config.init_range, generator=generator)
        if isinstance(self.core, nn.LSTM) and self.bias:
            n, bias = self.hidden_size, self.core.get_parameter("bias_ih_l0")
            with torch.no_grad():  # torch's order of gates: input, forget, cell, output
                bias[:n] += config.input_bias
                bias[n : 2 * n] += config.forget_bias
        if config.init_std is not None:
            with torch.no_grad():  # the deviations are the last outputs, before their sigmoid
                self.readout.bias[self.head.n_outputs // 2 :] += math.log(config.init_std / (1.0 - config.init_std))

    def config(self) -> dict[str, Any]:
        """The settings that ``PolicyConfig`` takes to build a policy of this architecture."""
        return asdict(self._config)

    def free_parameters(self) -> list[nn.Parameter]:
        """The parameters that learn, in the order of ``vector()``."""
        return list(self._free)

    @property
    def state_size(self) -> int:
        """Numbers of recurrent state an episode carries.

        h and c for an LSTM, h for an Elman net, none without; then the noise in the previous action, if some of it
        lasts, and that action, if the policy sees it.
        """
        return self._core_state_size + self.noise_size + self.echo_size

    @property
    def _core_state_size(self) -> int:
        return {"lstm": 2, "rnn": 1, "none": 0}[self.core_type] * self.hidden_size

    def remember(
        self, observations: Tensor, state: Tensor | None = None, actions: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """What the core makes of whole episodes at once.

        Args:
            observations: ``(T, B, O)``, one episode a column.
            state: ``(B, state_size)`` before the first step; zeros if None.
            actions: ``(T, B, action_size)``, those taken; needed if the policy sees its previous action and T > 1.

        Returns:
            Features ``(T, B, H)`` and the state ``(B, state_size)`` after the last step, zero where it would hold the
            last action if that was not given, and the noise in it.
        """
        core_state = None if state is None else state[:, : self._core_state_size]
        if not self.echo_size:
            features, after = self._run_core(observations, core_state)
        else:
            echoes = self._echoes(observations, actions)
            if state is not None:
                echoes[0] = state[:, -self.echo_size :]
            features, after = self._run_core(torch.cat((observations, echoes[:-1]), -1), core_state)
            after = torch.cat((after, echoes[-1]), -1)
        if self.noise_size:
            quiet = after.new_zeros(len(after), self.noise_size)
            after = torch.cat((after[:, : self._core_state_size], quiet, after[:, self._core_state_size :]), -1)
        return features, after

    def unroll(
        self, observations: Tensor, actions: Tensor, lengths: NDArray[np.int64], state: Tensor | None = None
    ) -> Tensor:
        """``remember`` for whole episodes of different lengths, which does not pay for all of the padding.

        Args:
            observations: ``(T, B, O)``, one episode a column.
            actions: ``(T, B, action_size)``, those taken.
            lengths: Steps of each episode, ``(B,)``.
            state: ``(B, state_size)`` before the first step; zeros if None.

        Returns:
            Features ``(T, B, H)``; of no meaning beyond an episode's end.
        """
        if state is not None:
            return self.remember(observations, state, actions)[0]  # of few pieces, which are not worth sorting
        inputs = (
            torch.cat((observations, self._echoes(observations, actions)[:-1]), -1) if self.echo_size else observations
        )
        return run_in_buckets(self._features, inputs, lengths)

    def _echoes(self, observations: Tensor, actions: Tensor | None) -> Tensor:
        """The action before each step and after the last one, ``(T + 1, B, echo_size)``, zero before the first."""
        steps, width = observations.shape[:2]
        echoes = observations.new_zeros(steps + 1, width, self.echo_size)
        if actions is not None:
            echoes[1:] = self.head.echo(actions)
        elif steps > 1:
            raise ValueError("a policy that sees its previous action needs the actions of an episode")
        return echoes

    def _features(self, inputs: Tensor) -> Tensor:
        """What the core makes of whole episodes ``(T, B, I)``: ``(T, B, H)``."""
        if self.core_type == "lstm":  # the fused call alone: what nn.LSTM does around it is a tenth of a short batch
            start = (inputs.new_zeros(1, inputs.shape[1], self.hidden_size),) * 2
            return torch.lstm(inputs, start, self._core_weights, self.bias, 1, 0.0, False, False, False)[0]
        features: Tensor = torch.tanh(self.core(inputs)) if self.core_type == "none" else self.core(inputs)[0]
        return features

    def _run_core(self, inputs: Tensor, state: Tensor | None) -> tuple[Tensor, Tensor]:
        n = self.hidden_size
        if isinstance(self.core, nn.LSTM):
            before = None if state is None else (state[None, :, :n].contiguous(), state[None, :, n:].contiguous())
            features, (h, c) = self.core(inputs, before)
            return features, torch.cat((h[0], c[0]), dim=-1)
        if isinstance(self.core, nn.RNN):
            features, h = self.core(inputs, None if state is None else state[None].contiguous())
            return features, h[0]
        return torch.tanh(self.core(inputs)), inputs.new_zeros(inputs.shape[1], 0)

    def distribution(self, features: Tensor, actions: Tensor | None = None, state: Tensor | None = None) -> Tensor:
        """The head's parameters ``(T, B, n_outputs)``, given the history.

        Args:
            features: ``(T, B, H)``.
            actions: ``(T, B, action_size)``, those taken; needed if noise lasts and T > 1.
            state: ``(B, state_size)`` before the first step; zeros if None.
        """
        outputs: Tensor = self.readout(features)
        if not self.noise_size:
            return outputs
        mean, others = outputs.tensor_split([self.noise_size], -1)
        first = self._core_state_size
        noise = torch.zeros_like(mean)  # in the action before each step
        if state is not None:
            noise[0] = state[:, first : first + self.noise_size]
        if len(mean) > 1:
            if actions is None:
                raise ValueError("a policy whose noise lasts needs the actions of an episode")
            noise[1:] = actions[:-1] - mean[:-1]
        return torch.cat((mean + self.noise_memory * noise, others), -1)

    def _remember_noise(self, features: Tensor, action: Tensor, state: Tensor) -> None:
        """Put the noise in an action ``(B, action_size)``, taken with features ``(B, H)``, into the state after it."""
        first = self._core_state_size
        state[:, first : first + self.noise_size] = action - self.readout(features)[:, : self.noise_size]

    def forward(
        self, observations: Tensor, state: Tensor | None = None, actions: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """The head's parameters ``(T, B, n_outputs)`` for whole episodes, and the state; see ``remember``."""
        features, after = self.remember(observations, state, actions)
        if self.noise_size and actions is not None:
            self._remember_noise(features[-1], actions[-1], after)
        return self.distribution(features, actions, state), after

    @torch.no_grad()
    def act(self, observation: Tensor, state: Tensor | None, uniforms: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """One step for B environments.

        Args:
            observation: ``(B, O)``.
            state: ``(B, state_size)``, or None at the start of all episodes.
            uniforms: ``(B, head.draws)`` in (0, 1) to sample with; None for the greedy action.

        Returns:
            Actions ``(B, action_size)`` and the next state.
        """
        features, after = self.remember(observation[None], state)
        (outputs,) = self.distribution(features, state=state)
        actions = self.head.mode(outputs) if uniforms is None else self.head.sample(outputs, uniforms)
        if self.noise_size:
            self._remember_noise(features[0], actions, after)
        if self.echo_size:
            after[:, -self.echo_size :] = self.head.echo(actions)
        return actions, after

    def __getstate__(self) -> dict[str, Any]:
        """Without views, which a copy would detach from what they are views of."""
        return {**self.__dict__, "_places": [], "_views": []}

    def vector(self) -> NDArray[np.float64]:
        """The free parameters as one flat copy ``(P,)``."""
        places = [p.data_ptr() for p in self._free]
        if places != self._places:  # to make a view of a tensor takes as long as to copy it
            self._places, self._views = places, [p.detach().numpy() for p in self._free]
        return np.concatenate(self._views, axis=None, dtype=np.float64)

    def load_vector(self, vector: NDArray[np.floating]) -> None:
        """Set the free parameters from a flat vector ``(P,)``, the inverse of ``vector()``.

        Raises:
            ValueError: If the length is wrong or a number is not finite.
        """
        parameters = self.free_parameters()
        size = sum(p.numel() for p in parameters)
        if np.shape(vector) != (size,):
            raise ValueError(f"this policy has {size} free parameters, got a vector of shape {np.shape(vector)}")
        if not np.isfinite(vector).all():
            raise ValueError("the weight vector has a NaN or infinite entry")
        with torch.no_grad():
            for p, part in zip(
                parameters, np.split(vector, np.cumsum([p.numel() for p in parameters])[:-1]), strict=True
            ):
                p.copy_(torch.as_tensor(part.reshape(p.shape)))

    def compiled(self) -> CompiledPolicy:
        """The compiled twin that the lane engine runs, for weights of ``vector()``'s layout."""
        return compiled_policy(
            self.core_type,
            self.observation_size,
            self.hidden_size,
            self.head,
            self.bias,
            self.has_readout,
            self.echo_size > 0,
            self.noise_memory,
        )
