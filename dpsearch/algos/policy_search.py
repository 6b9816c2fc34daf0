"""Policy search by black-box optimisation: chapters 4 and 5 of the thesis, sections 4.7.3 and 5.4.2.

A point of the search is the weight vector of a policy, its fitness the return of an episode (or the mean of several)
played with these weights. What happens within the episode is not looked at: phylogenetic, in the thesis's words.

    repeat   weights  = search.ask()                 (n, P)
             returns  = rollouts.evaluate(weights)   (n, E), each lane of the engine with its own weights
             search.tell(weights, mean of returns)
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, fields
from time import perf_counter
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray

from dpsearch.algos.base import RECENT_EPISODES, Algorithm, Env, Metrics
from dpsearch.algos.memory import require_memory
from dpsearch.algos.settings import require
from dpsearch.kernels.philox import stream_key
from dpsearch.options import dataclass_of, options_of
from dpsearch.policies import PolicyConfig
from dpsearch.search import CMAES, FEM, NES, SNES, XNES, Restarts, Search
from dpsearch.search.restarts import RULES

SEARCH = 5  # purpose of the seed's stream that the search draws from; see those in ``base``
CHOICES = ("auto", "best", "mean")
GIVEN = frozenset({"x0", "seed", "target", "max_evaluations", "diagonal"})
"""Arguments of searches that are no settings: the run gives them, or the class of the search."""
MATRICES = 4  # as large as the covariance, which a search with one holds at least
FLAT = 100  # evaluations after which it is said if all fitness was the same


@dataclass
class PolicySearchConfig:
    """Settings of a search over the weights of a policy. A subclass adds the options of its kind of search.

    Attributes:
        sigma0: Initial standard deviation of the weights.
        start_std: Standard deviation of where the search begins, around the policy's initial weights (thesis: 1).
        episodes_per_fitness: Episodes whose mean return is a candidate's fitness.
        common_random_numbers: All candidates of a generation play the same episodes: same starts, same noise.
        greedy: Candidates take the most probable action instead of a random one. A policy for continuous actions is
            deterministic anyway.
        choice: The policy that the search comes up with. ``"best"``: the candidate of highest fitness so far;
            ``"mean"``: the centre of the search distribution, for where fitness is random and the best one was lucky;
            ``"auto"``: the mean where episodes or actions are random, as far as one can tell, else the best.
        restarts: Begin again elsewhere when the search distribution has shrunk to a point, or has run out of
            ``patience``. If False, the run ends there.
        tolx: A search has shrunk to a point when all its standard deviations are below this part of ``sigma0``.
    """

    sigma0: float = 1.0
    start_std: float = 0.0
    episodes_per_fitness: int = 1
    common_random_numbers: bool = True
    greedy: bool = False
    choice: str = "auto"
    restarts: bool = True
    tolx: float = 1e-6

    def __post_init__(self) -> None:
        """Raise a ValueError that names the field if a value is out of range."""
        require(
            self,
            {
                "sigma0": (0.0 < self.sigma0 < np.inf, "positive and finite"),
                "start_std": (0.0 <= self.start_std < np.inf, "0 or more"),
                "episodes_per_fitness": (self.episodes_per_fitness >= 1, "at least 1"),
                "tolx": (0.0 <= self.tolx < np.inf, "0 or more"),
                "choice": (self.choice in CHOICES, f"one of {', '.join(CHOICES)}"),
            },
        )

    def search_options(self) -> dict[str, Any]:
        """Arguments of the search, by name."""
        ours = {f.name for f in fields(PolicySearchConfig)} - {"tolx"}
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ours}


def config_of(search: type[Search]) -> type[Any]:
    """The settings of policy search by one kind of search: those that all share, and the arguments of its class.

    Args:
        search: The kind of search.
    """
    options = options_of(search, without={*GIVEN, *(f.name for f in fields(PolicySearchConfig))})
    words = {"__doc__": f"How {search.__name__} searches over the weights of a policy."}
    return dataclass_of(f"{search.__name__}Config", options, PolicySearchConfig, namespace=words)


class PolicySearch(Algorithm[PolicySearchConfig]):
    """A ``Search`` over the weights of a policy; see ``Algorithm`` for the arguments.

    A subclass says which, and takes its name and its options.

    Attributes:
        search_type: The kind of search.
        search: The search; its ``best.evaluation`` is the number of the evaluation that found the best candidate.
    """

    deterministic_policy = True
    default_policy = PolicyConfig(hidden_size=2, bias=False)
    search_type: ClassVar[type[Search]]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        cls.name, cls.config_type = cls.search_type.name, config_of(cls.search_type)

    def __init__(self, env: Env, config: PolicySearchConfig | None = None, **options: Any) -> None:
        super().__init__(env, config, **options)
        self.search = self._make_search()
        automatic = "best" if self.nothing_is_random else "mean"
        self._choice = automatic if self.config.choice == "auto" else self.config.choice
        self._incumbent = 0  # the evaluation that found the weights in self.policy, if the choice is the best
        self._rejected = 0  # the incumbent that was last found not to solve the task
        self._worst = np.inf  # fitness so far

    @property
    def _has_matrices(self) -> bool:
        """Whether the search distribution has a covariance matrix, and not only a variance of each weight."""
        return self.search_type is not SNES and getattr(self.config, "covariance", "full") == "full"

    def _make_search(self) -> Search:
        config, key = self.config, stream_key(self.seed, SEARCH)
        options = config.search_options()
        x0 = self.policy.vector()
        if self._has_matrices:
            require_memory(
                "hidden_size",
                MATRICES * 8 * len(x0) ** 2,
                f"{self.name}'s matrices of {len(x0):,} x {len(x0):,} numbers",
                ": algo=snes, or algo=fem with algo.covariance=diagonal, has none",
            )
        if config.start_std > 0.0:
            x0 += config.start_std * np.random.default_rng(key).standard_normal(len(x0))
        if not config.restarts:
            return self.search_type(x0, config.sigma0, seed=key, **options)
        spread = max(config.start_std / config.sigma0, 1.0)
        options = {**dict.fromkeys(RULES), **options}  # of a solved task, all candidates may have the same return
        return Restarts(self.search_type, x0, config.sigma0, spread=spread, seed=key, **options)

    @property
    def finished(self) -> bool:
        """Whether the search has nothing more to ask."""
        return bool(self.search.stop())

    @property
    def evaluations(self) -> int:
        """Fitness evaluations so far; of a solved task, those it took to come upon the policy that solves it."""
        return self.search.best.evaluation if self.solved and self._choice == "best" else self.search.evaluations

    def update(self) -> Metrics:
        """One generation: ask, play, tell."""
        start = perf_counter()
        points = self.search.ask()
        weights = points.astype(np.float32)  # as the policy will have them: balance can hang on the last digits
        asked = perf_counter()
        returns, lengths = self.rollouts.evaluate(
            self.policy,
            weights,
            key=self.training_key,
            episodes=self._episode_numbers(len(weights)),
            greedy=self.config.greedy,
        )
        played = perf_counter()
        fitness = returns.mean(axis=1)
        self.search.tell(points, fitness)
        self._warn_if_flat(fitness)
        self._load_policy()
        self.updates += 1
        self.episodes += returns.size
        self.env_steps += int(lengths.sum())
        self.recent_returns.extend(returns.ravel()[-RECENT_EPISODES:].tolist())
        told = perf_counter()
        return {
            "return": float(returns.mean()),
            "episode_length": float(lengths.mean()),
            "generation_best": float(fitness.max()),
            "best": self.search.best.fitness,
            "evaluations": self.search.evaluations,
            "sigma": float(np.exp(np.log(self.search.stds).mean())),
            "searches": self.search.runs if isinstance(self.search, Restarts) else 1,
            "time/sample": played - asked,
            "time/search": told - played + asked - start,
        }

    def _warn_if_flat(self, fitness: NDArray[np.float64]) -> None:
        """Say so, once, if the first evaluations tell no policy from another."""
        self._worst, evaluations = min(self._worst, float(fitness.min())), self.search.evaluations
        if evaluations - len(fitness) < FLAT <= evaluations and self._worst == self.search.best.fitness:
            warnings.warn(
                f"the first {evaluations} policies all have the same fitness, {self._worst:g}: the search has nothing "
                "to go by. Another reward or a larger sigma0 may tell policies apart",
                stacklevel=3,
            )

    def check_solved(self) -> bool:
        """Whether 100 evaluation episodes of the policy reach the environment's reward threshold.

        They are played only when the best candidate did in its own, and once for each, or, if the policy is the mean
        of the search, when the last 100 episodes did on average. One is enough where nothing is random.
        """
        threshold = self.rollouts.reward_threshold
        if threshold is None:
            return False
        if self._choice == "mean":
            return super().check_solved()
        if self.search.best.fitness < threshold or self._rejected == self._incumbent:
            return False
        if self.solving_return(1 if self.nothing_is_random else RECENT_EPISODES) >= threshold:
            return True
        self._rejected = self._incumbent
        return False

    def _load_policy(self) -> None:
        """Put what the search has come up with into the policy."""
        best = self.search.best
        if self._choice == "mean":
            self.policy.load_vector(self.search.mean)
        elif best.x is not None and best.evaluation != self._incumbent:
            self.policy.load_vector(best.x)
            self._incumbent = best.evaluation

    def _episode_numbers(self, candidates: int) -> NDArray[np.int64]:
        """The numbers of the episodes that each candidate plays, ``(n, E)``."""
        each = self.config.episodes_per_fitness
        if self.config.common_random_numbers:
            return np.broadcast_to(self.episodes + np.arange(each), (candidates, each))
        return self.episodes + np.arange(candidates * each).reshape(candidates, each)

    def state_dict(self) -> dict[str, Any]:
        """All that the rest of the run depends on."""
        return {
            **super().state_dict(),
            "search": _mapped(self.search.state_dict(), np.ndarray, torch.from_numpy),
            "incumbent": self._incumbent,
            "rejected": self._rejected,
            "worst": self._worst,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on exactly where ``state_dict`` was taken."""
        super().load_state_dict(state)
        self.search.load_state_dict(_mapped(state["search"], torch.Tensor, torch.Tensor.numpy))
        self._incumbent = state["incumbent"]
        self._rejected = state["rejected"]
        self._worst = state["worst"]


def _mapped(state: Any, kind: type[Any], convert: Callable[[Any], Any]) -> Any:
    """Nested dictionaries with all values of one kind converted: checkpoints hold tensors, searches arrays."""
    if isinstance(state, dict):
        return {key: _mapped(value, kind, convert) for key, value in state.items()}
    return convert(state) if isinstance(state, kind) else state


class NESPolicySearch(PolicySearch):
    """Natural evolution strategies over the weights of a policy."""

    search_type = NES


class XNESPolicySearch(PolicySearch):
    """Exponential NES over the weights of a policy."""

    search_type = XNES


class SNESPolicySearch(PolicySearch):
    """Separable NES over the weights of a policy."""

    search_type = SNES


class FEMPolicySearch(PolicySearch):
    """Fitness expectation maximization over the weights of a policy."""

    search_type = FEM


class CMAESPolicySearch(PolicySearch):
    """CMA-ES over the weights of a policy."""

    search_type = CMAES
