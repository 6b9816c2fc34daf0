"""The gym engine: rollouts for any Gymnasium environment.

As many episodes are begun as were asked for, and each is played to its end: to stop as soon as enough have
ended would favour the short ones.
"""

from __future__ import annotations

import warnings
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from dpsearch.kernels.philox import episode_seeds, stream_key
from dpsearch.policies.policy import RecurrentPolicy
from dpsearch.rollout.actor import LaneActor
from dpsearch.rollout.base import EnvironmentFailedError, Rollouts, check_fit
from dpsearch.rollout.episodes import Episodes
from dpsearch.rollout.gym_envs import EnvSource, limit_or_default, single_env
from dpsearch.rollout.gym_lanes import GymLanes, ScalarLanes, Vectorization, open_lanes

OnError = Literal["raise", "retry"]
MOST_ATTEMPTS = 10
"""Times that an episode is begun before its failures are taken for the environment's rule."""
RETRY = 1_000  # purpose of the seeds of a second attempt; one more for each further
LARGE, SMALL = 100.0, 0.01
"""Observations beyond are warned of."""
_IDLE = -1


class GymEngine(Rollouts):
    """Plays episodes of any Gymnasium environment, many side by side.

    An episode is a function of its key and number, with one exception: a vector environment that resets
    itself (one that came ready, or the environment's own vector class) is seeded once, at the beginning of
    each call. There an episode depends on the first one's number and on ``num_envs`` as well.

    Args:
        env: An id, a spec, or a factory; or a ready environment, which is played as it is, in one lane; or a
            ready vector environment. What came ready is not closed here.
        num_envs: The most episodes played side by side; 32 if None.
        max_episode_steps: Step limit of an episode, in place of the registered one of an id; 1,000, with a warning, if
            neither says. A ready vector environment keeps to its own, which this must not be below.
        vectorization: ``"sync"`` steps the environments one after the other, ``"async"`` each in a process of
            its own, ``"vector_entry_point"`` takes the vector class that the environment is registered with.
        env_kwargs: Arguments of the environment, or of the factory.
        on_error: ``"raise"`` ends the call when an environment raises, or shows or pays what is not a finite number of
            the right shape. ``"retry"`` plays such an episode again, with a new environment and another seed.

    Attributes:
        observation_space: The environment's own, of a single environment.
        action_space: The environment's own, of a single environment.
        observation_size: Length O of the flat observation a policy sees.
        max_steps: Step cap of an episode.
        reward_threshold: Mean return that counts as solved, or None if the environment names none.
        make_env: Makes one more environment of the kind; None for an environment that came ready made.
        mirror_signs: See ``Rollouts``.
        failures: Episodes so far that failed and were played again.

    Raises:
        UnsupportedSpaceError: If a space is of a kind that no policy can handle.
        ValueError: If an argument is out of range, the environment is unknown or has an unsupported autoreset mode, or
            an option does not apply to it.
    """

    def __init__(
        self,
        env: EnvSource,
        *,
        num_envs: int | None = None,
        max_episode_steps: int | None = None,
        vectorization: Vectorization = "sync",
        env_kwargs: dict[str, Any] | None = None,
        on_error: OnError = "raise",
    ) -> None:
        for name, number in (("num_envs", num_envs), ("max_episode_steps", max_episode_steps)):
            if number is not None and number < 1:
                raise ValueError(f"{name} must be at least 1, got {number}")
        if on_error not in ("raise", "retry"):
            raise ValueError(f"on_error must be 'raise' or 'retry', got {on_error!r}")
        self._lanes = open_lanes(env, num_envs, max_episode_steps, vectorization, env_kwargs or {})
        self.observation_space = self._lanes.observation_space
        self.action_space = self._lanes.action_space
        self.observation_size = self._lanes.observation_size
        self.reward_threshold = self._lanes.reward_threshold
        self.mirror_signs = self._lanes.mirror_signs
        self.make_env = single_env(env, env_kwargs, max_episode_steps)
        if on_error == "retry" and (type(self._lanes) is not ScalarLanes):
            self.close()
            raise ValueError("on_error must be 'raise' unless vectorization is 'sync' and env is an id or a factory")
        self.on_error, self.failures = on_error, 0
        self._looked_at = False
        self.max_steps = limit_or_default(max_episode_steps, self._lanes.step_limit)

    @override
    def close(self) -> None:
        """Close the environments that were made here."""
        self._lanes.close()

    @override
    def play(
        self,
        policy: RecurrentPolicy,
        weights: NDArray[np.float64],
        key: int,
        numbers: NDArray[np.uint64],
        candidates: NDArray[np.int64],
        greedy: bool,
        *,
        record: bool,
    ) -> Episodes:
        """Play the queued episodes; see ``Rollouts.play``.

        Raises:
            EnvironmentFailedError: If an environment fails, and ``on_error`` does not say to try again.
        """
        check_fit(policy, self.observation_size, self._lanes.action_size)
        actor = LaneActor(policy, weights, self._lanes.width(len(numbers)), key, greedy)
        game = _Game(self._lanes, actor, key, numbers, candidates, self.max_steps, self.on_error, not self._looked_at)
        try:
            episodes = game.play(record)
            if not self._looked_at:
                self._looked_at = True
                _warn_of_scale(game.largest)
            return episodes
        except BaseException:
            self.close()  # the environments stopped in the middle of a step
            raise
        finally:
            self.failures += game.failures


class _Game:
    """One call of ``play``: which lane plays which episode, and how far each has come.

    A lane that is free takes the next episode. Where environments start episodes by themselves, every lane has a fixed
    share instead: then an episode does not depend on how long the others are.
    """

    def __init__(
        self,
        lanes: GymLanes,
        actor: LaneActor,
        key: int,
        numbers: NDArray[np.uint64],
        candidates: NDArray[np.int64],
        max_steps: int,
        on_error: OnError,
        measures: bool,
    ) -> None:
        n, width = len(numbers), lanes.width(len(numbers))
        self.failures = 0
        self._lanes, self._actor, self._key, self._numbers, self._candidates = lanes, actor, key, numbers, candidates
        self._max_steps, self._retry = max_steps, on_error == "retry"
        self._seeds, self._attempts = episode_seeds(key, numbers), np.ones(n, np.int64)
        self._returns, self._lengths, self._terminated = np.zeros(n), np.zeros(n, np.int64), np.zeros(n, np.bool_)
        self._recorder = _Recorder()
        self._measures = measures
        self.largest = np.zeros(lanes.observation_size, np.float32)  # size of each component, if it is measured
        self._job = np.where(np.arange(width) < n, np.arange(width), _IDLE)  # the episode that each lane plays
        shared = iter(range(width, n))
        self._following = [shared if lanes.restarts else iter(range(i + width, n, width)) for i in range(width)]

    def play(self, record: bool) -> Episodes:
        """Play all episodes to their ends."""
        lanes = self._lanes
        lanes.start(self._seeds[self._job])  # an idle lane gets the last seed, and is not looked at
        self._begin(self._job != _IDLE)
        self._settle(lanes.failures)
        while (busy := self._job != _IDLE).any():
            self._step(busy, record)
        size = lanes.observation_size, lanes.action_size
        return self._recorder.episodes(*size, self._lengths, self._terminated, self._returns)

    def _begin(self, fresh: NDArray[np.bool_]) -> None:
        where = np.flatnonzero(fresh)
        self._actor.begin(where, self._numbers[self._job[where]], self._candidates[self._job[where]])

    def _step(self, busy: NDArray[np.bool_], record: bool) -> None:
        """Play one step in the busy lanes; those whose episode ends take the next."""
        lanes, job = self._lanes, self._job
        observations = lanes.observations.copy()
        if self._measures:
            np.maximum(self.largest, np.abs(observations[busy]).max(axis=0), out=self.largest)
        actions = self._actor.act(observations)
        step = lanes.step(actions, busy)
        failed = dict(lanes.failures)
        played = busy & step.played
        now = job[played]
        if record:
            self._recorder.add(now, self._lengths[now], observations[played], actions[played], step.rewards[played])
        self._returns[now] += step.rewards[played]
        self._lengths[now] += 1
        over = played & (step.terminated | step.truncated)
        self._terminated[job[over]] = step.terminated[over]
        cut = played & ~over & (self._lengths[job] >= self._max_steps)
        if cut.any() and not lanes.restarts:
            raise ValueError(
                "max_episode_steps must not be below the limit of a vector environment that starts episodes by itself: "
                f"this one goes on after {self._max_steps} steps"
            )
        for lane in np.flatnonzero(over | cut):
            job[lane] = next(self._following[lane], _IDLE)
        fresh = (over | cut) & (job != _IDLE)
        lanes.restart(fresh, self._seeds[job])
        self._begin(fresh | (busy & ~step.played))  # where the row was no step, the episode begins only now
        self._settle(failed | lanes.failures)

    def _settle(self, failed: dict[int, Exception]) -> None:
        """Deal with failed episodes, so that every lane that is played shows finite numbers."""
        failed = dict(failed)  # beginning again changes the lanes' own
        finite = np.isfinite(self._lanes.observations)
        if not finite.all():
            for lane in np.flatnonzero((self._job != _IDLE) & ~finite.all(axis=1)).tolist():
                failed.setdefault(lane, FloatingPointError("the observation is not finite"))
        for lane, error in failed.items():
            again: Exception | None = error
            while again is not None:
                again = self._try_again(lane, again)

    def _try_again(self, lane: int, error: Exception) -> Exception | None:
        """Begin a failed episode again, with another seed; returns how that fails too, if it does.

        Raises:
            EnvironmentFailedError: If failures are to be raised, or this episode failed too often.
        """
        lanes, job = self._lanes, self._job[lane]
        what = str(error) if isinstance(error, FloatingPointError) else f"{type(error).__name__}: {error}"
        where = f"step {self._lengths[job]} of episode {self._numbers[job]}, seed {self._seeds[job]}"
        if not self._retry or self._attempts[job] >= MOST_ATTEMPTS or not isinstance(lanes, ScalarLanes):
            raise EnvironmentFailedError(f"the environment failed at {where}: {what}") from error
        warnings.warn(f"the environment failed at {where}, which is played again: {what}", stacklevel=2)
        self.failures += 1
        key = stream_key(self._key, RETRY + int(self._attempts[job]))
        self._attempts[job] += 1
        self._seeds[job] = episode_seeds(key, self._numbers[job : job + 1])[0]
        self._returns[job], self._lengths[job] = 0.0, 0
        self._recorder.forget(job)
        lanes.replace(lane)
        only = np.arange(len(self._job)) == lane
        lanes.restart(only, self._seeds[self._job])
        self._begin(only)
        if lane in lanes.failures:
            return lanes.failures[lane]
        finite = np.isfinite(lanes.observations[lane]).all()
        return None if finite else FloatingPointError("the observation is not finite")


def _warn_of_scale(largest: NDArray[np.float32]) -> None:
    """Warn of observations that are so large that a policy's units saturate, or so small that it hardly sees them."""
    worst = int(largest.argmax())
    if largest[worst] > LARGE or 0.0 < largest[worst] < SMALL:
        warnings.warn(
            f"observations are of size {largest[worst]:.2g} (component {worst}); policies learn best from numbers "
            "of size 1: scale them, for example by gymnasium.wrappers.NormalizeObservation or RescaleObservation",
            stacklevel=3,
        )


class _Recorder:
    """Collects steps in the order they were played, and sorts them into episodes at the end."""

    def __init__(self) -> None:
        self._rows: list[tuple[NDArray[Any], ...]] = []

    def forget(self, episode: int) -> None:
        """Drop all steps of an episode that is begun again."""
        for k, row in enumerate(self._rows):
            keep = row[0] != episode
            if not keep.all():
                self._rows[k] = tuple(part[keep] for part in row)

    def add(self, *row: NDArray[Any]) -> None:
        """One step in n lanes: episode ``(n,)``, time ``(n,)``, observations, actions, rewards."""
        self._rows.append(row)

    def episodes(
        self,
        observation_size: int,
        action_size: int,
        lengths: NDArray[np.int64],
        terminated: NDArray[np.bool_],
        returns: NDArray[np.float64],
    ) -> Episodes:
        """The steps as ``(T, B, ..)`` arrays; without steps T is 0."""
        n = len(lengths)
        longest = int(lengths.max()) if self._rows else 0
        observations = np.zeros((longest, n, observation_size), np.float32)
        actions = np.zeros((longest, n, action_size), np.float32)
        rewards = np.zeros((longest, n), np.float32)
        if self._rows:
            episode, time, *values = (np.concatenate(column) for column in zip(*self._rows, strict=True))
            for array, played in zip((observations, actions, rewards), values, strict=True):
                array[time, episode] = played
        return Episodes(observations, actions, rewards, lengths, terminated, returns)
