"""The policy: a core that remembers, a linear read-out, and a head that makes it a distribution (section 3.3.3).

Only the outputs are stochastic; the memory is a deterministic function of the history, so its gradient is plain
backpropagation through time, which torch does in one fused call for a whole batch of episodes.
"""

from __future__ import annotations

import math
from dataclasses import asdict, replace
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from dpsearch.policies.buckets import run_in_buckets
from dpsearch.policies.compiled import CompiledPolicy, compile_policy
from dpsearch.policies.config import PolicyConfig
from dpsearch.policies.cores import CORES
from dpsearch.policies.heads import Head
from dpsearch.policies.observations import observation_size
from dpsearch.policies.spaces import head_for


class RecurrentPolicy(nn.Module):
    """Maps histories to distributions over actions.

    Args:
        observation_size: Length O of a flat observation.
        head: The distribution over actions.
        config: Architecture and initial weights; the thesis's LSTM of 10 cells if None.
        seed: Seed of the initial weights.

    Raises:
        ValueError: If a size is below 1, or the architecture does not fit the head.
    """

    def __init__(self, observation_size: int, head: Head, config: PolicyConfig | None = None, *, seed: int = 0) -> None:
        config = replace(config or PolicyConfig())
        if observation_size < 1:
            raise ValueError(f"observation_size must be positive, got {observation_size}")
        if config.init_std is not None and not (head.deviations and config.bias and config.readout):
            raise ValueError(
                "init_std must be null unless the policy is Gaussian, with biases and a read-out, "
                f"got {config.init_std}"
            )
        if config.noise_memory and not (head.deviations and config.readout):
            raise ValueError(
                f"noise_memory must be 0 unless the policy is Gaussian, with a read-out, got {config.noise_memory}"
            )
        if not config.readout and config.hidden_size < head.n_outputs:
            raise ValueError(f"readout must be true if hidden_size is below the {head.n_outputs} outputs needed")
        super().__init__()
        self.observation_size = observation_size
        self.hidden_size = config.hidden_size
        self.head = head
        self._config = config
        self.echo_size = head.echo_size if config.previous_action else 0
        self.noise_memory, self.noise_size = config.noise_memory, head.action_size if config.noise_memory else 0
        self.core = CORES[config.core](observation_size + self.echo_size, config.hidden_size, config.bias)
        self.readout = nn.Linear(config.hidden_size, head.n_outputs, bias=config.bias)
        if not config.readout:
            for fixed in self.readout.parameters():
                fixed.requires_grad_(False)
                nn.init.zeros_(fixed)
            nn.init.eye_(self.readout.weight)
        # found once: they are asked for at every update
        self._free = [p for p in self.parameters() if p.requires_grad]
        self._places: list[int] = []  # addresses of the free parameters when _views were made
        self._views: list[NDArray[Any]] = []
        self._compiled: CompiledPolicy | None = None
        self.readout_layer = self.readout.weight, self.readout.bias if config.bias else None  # as ``Categorical`` needs
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
            observation_space: The observation space of a single environment.
            action_space: The action space of a single environment; Discrete and MultiDiscrete get a softmax head, a
                Box a Gaussian.
            config: Architecture and initial weights; the thesis's LSTM of 10 cells if None.
            deterministic: Give a Box a deterministic head instead, for black-box search.
            seed: Seed of the initial weights.

        Raises:
            UnsupportedSpaceError: If a space is of a kind that no policy can handle.
        """
        config = config or PolicyConfig()
        head = head_for(action_space, deterministic=deterministic, squash=config.readout)
        return cls(observation_size(observation_space), head, config, seed=seed)

    def initialise(self, seed: int) -> None:
        """Draw the free parameters anew.

        Args:
            seed: In [0, 2**63).
        """
        config, generator = self._config, torch.Generator().manual_seed(seed)
        self.core.initialise(generator, config.init_range, config.gate_biases)
        if config.readout:
            for parameter in self.readout.parameters():
                nn.init.uniform_(parameter, -config.init_range, config.init_range, generator=generator)
        if config.init_std is not None:
            with torch.no_grad():
                self.readout.bias[-self.head.deviations :] += math.log(config.init_std / (1.0 - config.init_std))

    def config(self) -> dict[str, Any]:
        """The settings that ``PolicyConfig`` takes to build a policy of this architecture."""
        return asdict(self._config)

    def free_parameters(self) -> list[nn.Parameter]:
        """The parameters that learn, in the order of ``vector()``."""
        return list(self._free)

    @property
    def state_size(self) -> int:
        """Numbers of recurrent state that an episode carries.

        The core's state, then the noise in the previous action, if noise lasts, and then that action, if the policy
        sees it.
        """
        return self.core.state_size + self.noise_size + self.echo_size

    def remember(
        self, observations: Tensor, state: Tensor | None = None, actions: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """The core's features for whole episodes at once.

        Args:
            observations: ``(T, B, O)``, one episode a column.
            state: ``(B, state_size)`` before the first step; zeros if None.
            actions: Actions taken, ``(T, B, action_size)``; needed if the policy sees its previous action and T > 1.

        Returns:
            Features ``(T, B, H)`` and the state ``(B, state_size)`` after the last step. The state has zeros in place
            of the noise in the last action, and of that action too if ``actions`` is None.
        """
        inputs, echoes = observations, None
        if self.echo_size:
            echoes = self._echoes(observations, actions)
            if state is not None:
                echoes[0] = state[:, -self.echo_size :]
            inputs = torch.cat((observations, echoes[:-1]), -1)
        core_state = None if state is None else state[:, : self.core.state_size]
        features, parts = self.core(inputs, self.core.start(inputs, core_state))
        after = [part[0] for part in parts]
        if self.noise_size:
            after.append(inputs.new_zeros(inputs.shape[1], self.noise_size))
        if echoes is not None:
            after.append(echoes[-1])
        return features, torch.cat(after, -1) if after else inputs.new_zeros(inputs.shape[1], 0)

    def unroll(
        self, observations: Tensor, actions: Tensor, lengths: NDArray[np.int64], state: Tensor | None = None
    ) -> Tensor:
        """``remember`` for whole episodes of different lengths, without paying for all of the padding.

        Args:
            observations: ``(T, B, O)``, one episode a column.
            actions: Actions taken, ``(T, B, action_size)``.
            lengths: Steps of each episode, ``(B,)``.
            state: ``(B, state_size)`` before the first step; zeros if None.

        Returns:
            Features ``(T, B, H)``; beyond an episode's end they mean nothing.
        """
        if state is not None:
            return self.remember(observations, state, actions)[0]  # a stream's few pieces are not worth sorting
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
        """The core's features ``(T, B, H)`` for whole episodes ``(T, B, I)``, from their start."""
        features: Tensor = self.core(inputs, self.core.start(inputs))[0]
        return features

    def distribution(self, features: Tensor, actions: Tensor | None = None, state: Tensor | None = None) -> Tensor:
        """The head's parameters ``(T, B, n_outputs)``, given the history.

        Args:
            features: ``(T, B, H)``.
            actions: Actions taken, ``(T, B, action_size)``; needed if noise lasts and T > 1.
            state: ``(B, state_size)`` before the first step; zeros if None.
        """
        outputs: Tensor = self.readout(features)
        if not self.noise_size:
            return outputs
        mean, others = outputs.tensor_split([self.noise_size], -1)
        first = self.core.state_size
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
        first = self.core.state_size
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
        """Without views, which a copy would detach from the weights, and without compiled functions."""
        return {**self.__dict__, "_places": [], "_views": [], "_compiled": None}

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
        """The compiled twin that engines play, for weights of ``vector()``'s layout."""
        if self._compiled is None:  # made once: engines ask for it at every call
            self._compiled = compile_policy(
                self.core,
                self.head,
                self.observation_size,
                readout=self._config.readout,
                previous_action=self._config.previous_action,
                noise_memory=self.noise_memory,
            )
        return self._compiled
