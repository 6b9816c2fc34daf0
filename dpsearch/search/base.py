"""Search: the interface of every black-box search: ask for points, tell their fitness, see why to stop.

::

    search = XNES(x0=np.zeros(5), sigma0=0.5, seed=1)
    while not search.stop():
        points = search.ask()                    # (n, d)
        search.tell(points, [f(x) for x in points])
    print(search.best.fitness, search.best.x)

Fitness is maximised: to minimise a cost, tell its negative.
"""

from __future__ import annotations

import copy
import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import ThreadpoolController

from dpsearch.search.arguments import accepted_by, array, number, refuse_unknown, shown, whole
from dpsearch.search.standstill import Standstill

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

WIDEST = 1e100  # a standard deviation beyond which numbers soon overflow, and below 1 / WIDEST underflow


@dataclass(frozen=True)
class Best:
    """The best point told so far.

    Attributes:
        x: ``(d,)``, or None before the first finite fitness.
        fitness: Its fitness, -inf before that.
        evaluation: The number of the evaluation that found it, from 1; 0 before that.
    """

    x: Vector | None
    fitness: float
    evaluation: int


@dataclass(frozen=True)
class Result:
    """Result of a search.

    Attributes:
        best: The best point told so far.
        evaluations: Fitness values told.
        generations: Calls of ``tell``.
        invalid: How many of the values were NaN or infinite.
        mean: ``(d,)``, the centre of the search distribution: on a noisy fitness better than ``best``.
        stds: ``(d,)``, its standard deviations along the axes.
        stop: Why it stopped, reason -> value; empty if it has not.
    """

    best: Best
    evaluations: int
    generations: int
    invalid: int
    mean: Vector
    stds: Vector
    stop: dict[str, Any]


class Search(ABC):
    """A search for the point of highest fitness, by asking and telling.

    All randomness is a function of (seed, generation): asking twice gives the same points, and a search goes on from
    ``state_dict`` bit for bit. Linear algebra uses one thread: sums do not depend on how many there are, and at
    these sizes more would be slower, on a busy machine by far.

    Args:
        x0: ``(d,)``, where to begin.
        sigma0: Initial standard deviation, from 1e-100 to 1e100: one number, or ``(d,)`` of them.
        population: Points of a generation; the algorithm's own choice if None.
        seed: Seed of everything random, in [0, 2**64); drawn from the system if None.
        target: Stop when this fitness is reached.
        max_evaluations: Stop after the generation with which so many fitness values are told.
        tolx: Stop when all standard deviations are below this part of their initial values.
        patience: Stop when so many evaluations in a row brought no better fitness.
        tolfun: Stop when the fitness of several generations differs by no more than this, or by rounding only (then
            0 is enough); None for no such rule. A needle in a haystack takes longer than that to be found.
        stagnation: Stop when neither the best fitness nor the median or mean of many values got better for so many
            populations' worth of evaluations, nor for a third of the run; None for no such rule.
        max_condition: Stop when the factor of the covariance has a larger condition number, axes measured in units of
            ``sigma0``; None for no such rule.

    Raises:
        TypeError: If an argument is unknown.
        ValueError: If an argument is out of range.
    """

    name: ClassVar[str]
    least_population: ClassVar[int] = 2
    _saved: ClassVar[tuple[str, ...]] = (
        "evaluations",
        "generations",
        "invalid",
        "_best",
        "_best_evaluation",
        "_best_x",
    )

    def __new__(cls, *args: Any, **options: Any) -> Self:
        """Refuse unknown arguments, wherever in the chain of constructors they would end up."""
        cls._check_names(options)
        return super().__new__(cls)

    def __init__(
        self,
        x0: ArrayLike,
        sigma0: ArrayLike,
        *,
        population: int | None = None,
        seed: int | None = None,
        target: float | None = None,
        max_evaluations: int | None = None,
        tolx: float = 1e-14,
        patience: int | None = None,
        tolfun: float | None = None,
        stagnation: int | None = None,
        max_condition: float | None = None,
    ) -> None:
        self.x0 = array("x0", x0, "a vector of finite numbers")
        if self.x0.ndim != 1 or self.x0.size == 0 or not np.isfinite(self.x0).all():
            raise ValueError(f"x0 must be a vector of finite numbers, got {shown(x0)}")
        accepted = f"a positive number, or one for each of {len(self.x0)} axes"
        self.sigma0 = array("sigma0", sigma0, accepted)
        if self.sigma0.shape not in ((), self.x0.shape) or not (np.isfinite(self.sigma0) & (self.sigma0 > 0)).all():
            raise ValueError(f"sigma0 must be {accepted}, got {shown(sigma0)}")
        if (self.sigma0 > WIDEST).any() or (self.sigma0 < 1.0 / WIDEST).any():
            raise ValueError(f"sigma0 must be from {1.0 / WIDEST:g} to {WIDEST:g}, got {shown(sigma0)}")
        if population is None:
            population = self.default_population(len(self.x0))
        self.population = whole("population", population, self.least_population)
        self.seed = (
            int(np.random.SeedSequence().generate_state(1, np.uint64)[0])
            if seed is None
            else whole("seed", seed, 0, below=2**64)
        )
        self.target = None if target is None else number("target", target, "a number or None")
        self.max_evaluations = None if max_evaluations is None else whole("max_evaluations", max_evaluations, 1)
        self.tolx = number("tolx", tolx, "0 or more", 0.0)
        self.patience = None if patience is None else whole("patience", patience, 1)
        self._standstill = Standstill(
            None if tolfun is None else number("tolfun", tolfun, "0 or more, or None", 0.0),
            None if stagnation is None else whole("stagnation", stagnation, 1),
            None if max_condition is None else number("max_condition", max_condition, "1 or more, or None", 1.0),
            self.ranked,
            self.dimension,
        )
        self.evaluations = 0
        self.generations = 0
        self.invalid = 0
        self._best = -np.inf
        self._best_evaluation = 0
        self._best_x = np.zeros(0)
        self._asked: Matrix | None = None
        self._numbers = np.random.Generator(np.random.Philox())

    @staticmethod
    def default_population(dimension: int) -> int:
        """4 + floor(3 ln d), the usual choice of evolution strategies."""
        return 4 + int(3 * np.log(dimension))

    @classmethod
    def _check_names(cls, options: dict[str, Any]) -> None:
        """Raise a TypeError that names an unknown argument."""
        refuse_unknown(cls.__name__, options, accepted_by(cls))

    @property
    def dimension(self) -> int:
        """Length d of a point."""
        return len(self.x0)

    @property
    def ranked(self) -> int:
        """Number of points that are ranked together: those of a generation."""
        return self.population

    @property
    def condition(self) -> float:
        """Condition number of the covariance's factor, with axes in units of ``sigma0``; here of a diagonal one."""
        relative = self.stds / self.sigma0
        return float(relative.max() / relative.min())

    @property
    @abstractmethod
    def mean(self) -> Vector:
        """``(d,)``: the centre of the search distribution."""

    @property
    @abstractmethod
    def stds(self) -> Vector:
        """``(d,)``: the standard deviations of the search distribution along the axes."""

    @abstractmethod
    def _propose(self) -> Matrix:
        """New points ``(n, d)``, a function of the state alone."""

    @abstractmethod
    def _learn(self, points: Matrix, fitness: Vector) -> None:
        """Move the search distribution. Fitness is -inf where it was NaN or infinite."""

    def ask(self) -> Matrix:
        """Points ``(n, d)`` to be evaluated next. They do not change until they are told."""
        if self._asked is None:
            with one_blas_thread():
                self._asked = self._propose()
        return self._asked.copy()

    def tell(self, points: ArrayLike, fitness: ArrayLike) -> None:
        """Learn from the fitness of the points asked.

        Args:
            points: ``(n, d)``: those that ``ask`` gave, or other points in their place (repaired or improved ones).
                Of a point that was not asked, only the direction counts where it lies further from the mean than the
                search distribution would have drawn it: one far point must not decide on a whole generation.
            fitness: ``(n,)``, more is better. NaN and infinities count as the worst of all.

        Raises:
            ValueError: If something is no number, a point is not finite, or shapes are not those of the points asked.
            RuntimeError: If nothing was asked.
        """
        if self._asked is None:
            raise RuntimeError("tell() needs points that were asked: call ask() first")
        told, values = array("points", points, "numbers"), array("fitness", fitness, "numbers")
        if told.shape != self._asked.shape or values.shape != told.shape[:1]:
            expected = f"points {self._asked.shape} and fitness {self._asked.shape[:1]}"
            raise ValueError(f"tell() expects {expected}, got {told.shape} and {values.shape}")
        if not np.isfinite(told).all():
            raise ValueError("points must be finite: a point told has a NaN or infinite coordinate")
        valid = np.isfinite(values)
        if not valid.all():
            if self.invalid == 0:
                warnings.warn("NaN or infinite fitness: ranked worst (said once; see result.invalid)", stacklevel=2)
            self.invalid += int((~valid).sum())
            values[~valid] = -np.inf
        with one_blas_thread():
            self._take(told, values)

    def _take(self, points: Matrix, fitness: Vector) -> None:
        """``tell`` for points and fitness that are known to be good; fitness is -inf where it was not finite."""
        top = int(np.argmax(fitness))
        if fitness[top] > self._best:
            self._best, self._best_x = float(fitness[top]), points[top].copy()
            self._best_evaluation = self.evaluations + top + 1
        self._learn(points, fitness)
        self.evaluations += len(fitness)
        self.generations += 1
        self._asked = None
        rules = self._standstill
        if rules.active and rules.observe(fitness) and rules.max_condition is not None:
            rules.condition = self.condition

    def stop(self) -> dict[str, Any]:
        """Reasons to stop, reason -> value; empty to go on.

        ``target``: that fitness is reached. ``max_evaluations``: that many values were told.
        ``tolx``: the search distribution has shrunk to a point. ``diverged``: it has grown beyond all bounds.
        ``no_effect``: a standard deviation added to the mean is lost in rounding, in each coordinate.
        ``patience``: no better fitness for so many evaluations. And where these rules are asked for: ``flat``
        (``tolfun``): all fitness is equal; ``stagnation``: no progress; ``condition``: too stretched a distribution.
        """
        reasons: dict[str, Any] = {}
        if self.target is not None and self._best >= self.target:
            reasons["target"] = self._best
        if self.max_evaluations is not None and self.evaluations >= self.max_evaluations:
            reasons["max_evaluations"] = self.evaluations
        if self.generations:
            mean, stds = self.mean, self.stds
            if (widest := float((stds / self.sigma0).max())) < self.tolx:
                reasons["tolx"] = widest
            if (widest := float(stds.max())) > WIDEST:
                reasons["diverged"] = widest
            if (mean + stds == mean).all():
                reasons["no_effect"] = widest
        if self.patience is not None and (vain := self.evaluations - self._best_evaluation) >= self.patience:
            reasons["patience"] = vain
        return reasons | (self._standstill.reasons(self._best_evaluation) if self._standstill.active else {})

    @property
    def best(self) -> Best:
        """The best point told so far."""
        return Best(self._best_x.copy() if self._best_evaluation else None, self._best, self._best_evaluation)

    @property
    def result(self) -> Result:
        """The best point so far, and the counts of the search."""
        return Result(self.best, self.evaluations, self.generations, self.invalid, self.mean, self.stds, self.stop())

    def maximize(self, f: Callable[[Vector], float], *, callback: Callable[[Self], object] | None = None) -> Result:
        """Ask and tell until ``stop()`` says why.

        Args:
            f: The fitness of one point ``(d,)``, a copy: f may write into it.
            callback: Called with the search after each generation. It stops the search by returning something false
                other than None: False, NumPy's False or 0.

        Raises:
            ValueError: If neither target, max_evaluations nor callback is given: on a flat or unbounded fitness
                nothing else might ever stop it.
        """
        if self.target is None and self.max_evaluations is None and callback is None:
            raise ValueError("maximize() needs a target, max_evaluations or a callback")
        while not self.stop():
            points = self.ask()
            self.tell(points, np.fromiter((f(x) for x in points.copy()), np.float64, len(points)))
            if callback is not None and (answer := callback(self)) is not None and not answer:
                break
        return self.result

    def state_dict(self) -> dict[str, Any]:
        """All that the rest of the search depends on: numbers and arrays."""
        state = {name.strip("_"): getattr(self, name) for name in self._saved}
        own = {"seed": self.seed, "dimension": self.dimension, "name": self.name}
        return copy.deepcopy(state) | own | {"standstill": self._standstill.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on exactly where ``state_dict`` was taken, from a search that was made with the same arguments.

        Raises:
            KeyError: If something is missing.
            ValueError: If the state is of another kind of search, or of another dimension.
        """
        if state["name"] != self.name:
            raise ValueError(f"the state is of a search by {state['name']}, this search is by {self.name}")
        if state["dimension"] != self.dimension:
            raise ValueError(
                f"the state is of dimension {state['dimension']}, this search of dimension {self.dimension}"
            )
        loaded = {name: state[name.strip("_")] for name in (*self._saved, "seed")}
        self._standstill.load_state_dict(state["standstill"])
        for name, value in loaded.items():
            mine = getattr(self, name)
            setattr(self, name, np.array(value, np.float64) if isinstance(mine, np.ndarray) else copy.deepcopy(value))
        self._asked = None

    def _generator(self) -> np.random.Generator:
        """The random numbers of this generation."""
        self._numbers.bit_generator.state = {  # a new generator would take as long as some searches do in all
            "bit_generator": "Philox",
            "state": {
                "counter": np.array([0, 0, self.generations, 0], np.uint64),
                "key": np.array([self.seed, 0], np.uint64),
            },
            "buffer": np.zeros(4, np.uint64),
            "buffer_pos": 4,
            "has_uint32": 0,
            "uinteger": 0,
        }
        return self._numbers


def one_blas_thread() -> AbstractContextManager[object]:
    """A context in which linear algebra uses one thread."""
    libraries = _libraries()
    if all(library.num_threads == 1 for library in libraries.lib_controllers):
        return nullcontext()  # cheaper, which shows where an evaluation costs nothing
    limit: AbstractContextManager[object] = libraries.limit(limits=1)
    return limit


@cache
def _libraries() -> ThreadpoolController:
    """The linear algebra libraries that are loaded, looked up once: it takes a few milliseconds."""
    libraries: ThreadpoolController = ThreadpoolController().select(user_api="blas")
    return libraries
