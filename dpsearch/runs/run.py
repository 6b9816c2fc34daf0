"""A run under way: an algorithm learns, and its progress is kept in the run's directory.

The checkpoint holds everything that the rest of the run depends on, and ``metrics.jsonl`` has one line for each of its
updates. So a run goes on, after whatever ended it, by loading the checkpoint and cutting the metrics back to it.
"""

from __future__ import annotations

import math
import signal
import sys
from contextlib import suppress
from time import perf_counter
from types import TracebackType
from typing import Any

import numpy as np

from dpsearch.algos import Algorithm, Evaluation
from dpsearch.files import versions, write_checkpoint
from dpsearch.rollout import EnvRecipe, LaneEngine
from dpsearch.runs.directory import RunDirectory
from dpsearch.runs.interruption import Interrupted, Interruption
from dpsearch.runs.limits import Limits
from dpsearch.runs.metrics import MetricsFile
from dpsearch.runs.policy_file import save_policy
from dpsearch.runs.progress_bar import Progress
from dpsearch.runs.tensorboard import TensorBoardLog

LOOK_SECONDS = 0.25  # between two checks of what is due besides learning
FIRST_PART = 100  # episodes of an evaluation that are played without looking for signals
POINT_SECONDS = 1.0  # between two points of the TensorBoard curves


class Run:
    """An algorithm at work in a run's directory; a context manager that closes what it opened.

    While it is entered, a first Ctrl-C, SIGTERM or SIGHUP is only noted.

    Args:
        directory: Directory of the run.
        algorithm: The algorithm that learns, new or loaded from the checkpoint.
        recipe: Recipe for the environment.
        limits: Limits of the run.
        settings: Nested plain values that decide what the run learns: the checkpoint keeps them, to compare, and
            TensorBoard's table shows them.
        metrics_checksum: Checksum of the metrics up to the checkpoint; None for a new run.
        checkpoint_seconds: Time between two checkpoints (s).
        progress: Whether to show progress.

    Raises:
        RunError: If another process is at work on this run, or the metrics do not go as far as the checkpoint.
    """

    def __init__(
        self,
        directory: RunDirectory,
        algorithm: Algorithm[Any],
        recipe: EnvRecipe,
        limits: Limits,
        *,
        settings: dict[str, Any] | None = None,
        metrics_checksum: int | None = None,
        checkpoint_seconds: float = 30.0,
        progress: bool = True,
    ) -> None:
        self.directory = directory
        self.algorithm = algorithm
        self.recipe = recipe
        self.limits = limits
        self._settings = settings or {}
        self._metrics = MetricsFile(directory.metrics, algorithm.updates, metrics_checksum)
        self._tensorboard = TensorBoardLog(directory.path, self._settings, algorithm.env_steps)
        self._interruption = Interruption()
        self._progress = Progress(algorithm, limits, show=progress)
        self._look, self._point = _Every(LOOK_SECONDS), _Every(POINT_SECONDS)
        self._save = _Every(checkpoint_seconds)
        self._wall = self._metrics.last.get("time/wall") or 0.0
        self._evaluated = directory.summary.exists()
        self._start = perf_counter() - self._wall  # as if it had never been interrupted

    def __enter__(self) -> Run:
        self._interruption.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._progress.close()
            self._metrics.close()
            self._tensorboard.close()
            self.algorithm.close()
        finally:
            self._interruption.__exit__(kind, error, trace)

    def learn(self) -> signal.Signals | None:
        """Learn until a limit is reached or a signal comes, which it returns.

        Raises:
            FloatingPointError: If something became NaN or infinite.
            ValueError: If nothing would ever stop it.
        """
        with suppress(FileNotFoundError):
            self.directory.summary.unlink()  # a shorter run's
        if not self.directory.checkpoint.exists():
            self.checkpoint()
        before = self.algorithm.updates
        if reason := self.algorithm.reason_to_stop(**vars(self.limits)):
            print(f"nothing more to learn: {reason}", file=sys.stderr)
        else:
            self.algorithm.learn(**vars(self.limits), callback=self._after_update)
        if self.algorithm.updates > before:
            self._evaluated = False
            self._tensorboard.write(self.algorithm.env_steps, perf_counter())
            self.checkpoint()
        self._progress.close()
        return self._interruption.signal

    def checkpoint(self) -> None:
        """Write the checkpoint, from which the run can go on, and the policy.

        Raises:
            FloatingPointError: If a weight became NaN or infinite; the checkpoint before is left as it is.
        """
        if not np.isfinite(self.algorithm.policy.vector()).all():
            raise FloatingPointError(f"a weight became NaN or infinite before update {self.algorithm.updates + 1}")
        self._metrics.sync()  # first, so that no checkpoint is ahead of its metrics
        self._tensorboard.flush()
        run = {"settings": self._settings, "metrics": self._metrics.checksum}
        write_checkpoint(self.directory.checkpoint, {**self.algorithm.content(), "run": run})
        save_policy(self.directory.policy, self.algorithm, self.recipe)

    def finish(self, evaluation_episodes: int) -> dict[str, Any] | signal.Signals:
        """Evaluate the policy, write the summary, and return it; or return the signal that came.

        What is NaN or infinite in the summary, as returns may be, is None.
        """
        algorithm = self.algorithm
        try:
            with self._interruption.at_once():
                stochastic = self._evaluate(evaluation_episodes)
                greedy = self._evaluate(evaluation_episodes, deterministic=True)
        except Interrupted:
            assert self._interruption.signal is not None
            return self._interruption.signal
        threshold = algorithm.rollouts.reward_threshold
        summary = {
            "algo": algorithm.name,
            "env": self.recipe.id,
            "env_kwargs": self.recipe.kwargs,
            "seed": algorithm.seed,
            "solved": None if threshold is None else algorithm.solved or stochastic.mean_return >= threshold,
            "reward_threshold": threshold,
            "updates": algorithm.updates,
            "episodes": algorithm.episodes,
            "evaluations": algorithm.evaluations,
            "env_steps": algorithm.env_steps,
            "wall_time_s": self._wall,
            "evaluation_episodes": evaluation_episodes,
            "return_stochastic": stochastic.mean_return,
            "return_stochastic_se": stochastic.standard_error,
            "return_greedy": greedy.mean_return,
            "return_greedy_se": greedy.standard_error,
            "versions": versions(),
        }
        summary = {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in summary.items()
        }
        if not self._evaluated:
            self._tensorboard.write_evaluation(algorithm.env_steps, stochastic.mean_return, greedy.mean_return)
        self.directory.write_summary(summary)
        return summary

    def _evaluate(self, n_episodes: int, *, deterministic: bool = False) -> Evaluation:
        """The final evaluation, whatever the episodes pay.

        Compiled code keeps signals waiting, so it plays them in parts, which grow as long as they take little time.
        """
        if not isinstance(self.algorithm.rollouts, LaneEngine):
            return self.algorithm.play_evaluation(n_episodes, deterministic=deterministic)
        parts, played, size = [], 0, FIRST_PART
        while played < n_episodes:
            start = perf_counter()
            count = min(size, n_episodes - played)
            parts.append(self.algorithm.play_evaluation(count, first=played, deterministic=deterministic))
            played += count
            size *= 2 if perf_counter() - start < LOOK_SECONDS else 1
            self._interruption.check()
        return Evaluation(np.concatenate([p.returns for p in parts]), np.concatenate([p.lengths for p in parts]))

    def _after_update(self, algorithm: Algorithm[Any], metrics: dict[str, float]) -> bool:
        """Keep an update's metrics; now and then do what takes time. False ends the learning."""
        now = perf_counter()
        self._wall = now - self._start
        recent = algorithm.recent_returns
        if recent:
            metrics = {**metrics, "recent_return": sum(recent) / len(recent)}
        counts = {
            "update": algorithm.updates,
            "episodes": algorithm.episodes,
            "env_steps": algorithm.env_steps,
        }
        self._metrics.add({**counts, **metrics, "time/wall": self._wall})
        self._tensorboard.add(metrics)
        if self._look.due(now):
            self._metrics.flush()
            self._progress.update(now)
            if self._point.due(now):
                self._tensorboard.write(algorithm.env_steps, now)
            if self._save.due(now):
                self.checkpoint()
        return self._interruption.signal is None


class _Every:
    """A clock that is due every so many seconds."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._next = perf_counter() + seconds

    def due(self, now: float) -> bool:
        if now < self._next:
            return False
        self._next = now + self._seconds
        return True
