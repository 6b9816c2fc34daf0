"""The gym engine: rollouts for any Gymnasium environment.

As many episodes are begun as were asked for, and each is played to its end: to stop as soon as enough have
ended would favour the short ones.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from dpsearch.kernels.philox import episode_seeds
from dpsearch.policies.policy import RecurrentPolicy
from dpsearch.rollout.actor import LaneActor
from dpsearch.rollout.base import Rollouts, check_fit
from dpsearch.rollout.episodes import Episodes
from dpsearch.rollout.gym_envs import EnvSource, Vectorization, open_lanes, single_env

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
        max_episode_steps: Step limit of an episode, in place of the registered one of an id. Needed if the
            environment has none. A ready vector environment keeps to its own, which this must not be below.
        vectorization: ``"sync"`` steps the environments one after the other, ``"async"`` each in a process of
            its own, ``"vector_entry_point"`` takes the vector class that the environment is registered with.
        env_kwargs: Arguments of the environment, or of the factory.

    Attributes:
        observation_space: The environment's own, of a single environment.
        action_space: The environment's own, of a single environment.
        observation_size: Length O of the flat observation a policy sees.
        max_steps: Step cap of an episode.
        reward_threshold: Mean return that counts as solved, or None if the environment names none.
        make_env: Makes one more environment of the kind; None if what there is came ready.

    Raises:
        UnsupportedSpaceError: If a space is of a kind that no policy can handle.
        ValueError: If an argument is out of range, the environment is unknown, has no step limit or an
            unsupported autoreset mode, or an option does not apply to it.
    """

    def __init__(
        self,
        env: EnvSource,
        *,
        num_envs: int | None = None,
        max_episode_steps: int | None = None,
        vectorization: Vectorization = "sync",
        env_kwargs: dict[str, Any] | None = None,
    ) -> None:
        for name, number in (("num_envs", num_envs), ("max_episode_steps", max_episode_steps)):
            if number is not None and number < 1:
                raise ValueError(f"{name} must be at least 1, got {number}")
        self._lanes = open_lanes(env, num_envs, max_episode_steps, vectorization, env_kwargs or {})
        self.observation_space = self._lanes.observation_space
        self.action_space = self._lanes.action_space
        self.observation_size = self._lanes.observation_size
        self.reward_threshold = self._lanes.reward_threshold
        self.make_env = single_env(env, env_kwargs, max_episode_steps)
        limits = [limit for limit in (max_episode_steps, self._lanes.step_limit) if limit is not None]
        if not limits:
            self.close()
            raise ValueError("the environment has no step limit: give max_episode_steps")
        self.max_steps: int = min(limits)

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
        """Play the queued episodes; see ``Rollouts.play``."""
        check_fit(policy, self.observation_size, self._lanes.action_size)
        try:
            return self._play_queue(policy, weights, key, numbers, candidates, greedy, record)
        except BaseException:
            self.close()  # the environments stopped in the middle of a step
            raise

    def _play_queue(
        self,
        policy: RecurrentPolicy,
        weights: NDArray[np.float64],
        key: int,
        numbers: NDArray[np.uint64],
        candidates: NDArray[np.int64],
        greedy: bool,
        record: bool,
    ) -> Episodes:
        lanes, n = self._lanes, len(numbers)
        width = lanes.width(n)
        actor = LaneActor(policy, weights, width, key, greedy)
        seeds = episode_seeds(key, numbers)
        returns, lengths, terminated = np.zeros(n), np.zeros(n, np.int64), np.zeros(n, np.bool_)
        job = np.where(np.arange(width) < n, np.arange(width), _IDLE)  # the episode that each lane plays
        # A lane that is free takes the next episode. Where environments start episodes by themselves, every
        # lane has a fixed share instead: then an episode does not depend on how long the others are.
        shared = iter(range(width, n))
        following = [shared if lanes.restarts else iter(range(i + width, n, width)) for i in range(width)]
        recorder = _Recorder()

        def begin(fresh: NDArray[np.bool_]) -> None:
            where = np.flatnonzero(fresh)
            actor.begin(where, numbers[job[where]], candidates[job[where]])

        lanes.start(seeds[job])  # an idle lane gets the last seed, and is not looked at
        begin(job != _IDLE)
        while (busy := job != _IDLE).any():
            observations = lanes.observations.copy()
            if not np.isfinite(observations).all():
                _refuse(observations, busy, numbers[job], lengths[job])
            actions = actor.act(observations)
            step = lanes.step(actions, busy)
            played = busy & step.played
            now = job[played]
            if record:
                recorder.add(now, lengths[now], observations[played], actions[played], step.rewards[played])
            returns[now] += step.rewards[played]
            lengths[now] += 1
            over = played & (step.terminated | step.truncated)
            terminated[job[over]] = step.terminated[over]
            cut = played & ~over & (lengths[job] >= self.max_steps)
            if cut.any() and not lanes.restarts:
                raise ValueError(f"the vector environment goes on after {self.max_steps} steps and cannot be cut off")
            for lane in np.flatnonzero(over | cut):
                job[lane] = next(following[lane], _IDLE)
            fresh = (over | cut) & (job != _IDLE)
            lanes.restart(fresh, seeds[job])
            begin(fresh | (busy & ~step.played))  # where the row was no step, the episode begins only now
        return recorder.episodes(n, self.observation_size, lanes.action_size, lengths, terminated, returns)


class _Recorder:
    """Collects steps in the order they were played, and sorts them into episodes at the end."""

    def __init__(self) -> None:
        self._rows: list[tuple[NDArray[Any], ...]] = []

    def add(self, *row: NDArray[Any]) -> None:
        """One step in n lanes: episode ``(n,)``, time ``(n,)``, observations, actions, rewards."""
        self._rows.append(row)

    def episodes(
        self,
        n: int,
        observation_size: int,
        action_size: int,
        lengths: NDArray[np.int64],
        terminated: NDArray[np.bool_],
        returns: NDArray[np.float64],
    ) -> Episodes:
        longest = int(lengths.max()) if self._rows else 0
        observations = np.zeros((longest, n, observation_size), np.float32)
        actions = np.zeros((longest, n, action_size), np.float32)
        rewards = np.zeros((longest, n), np.float32)
        if self._rows:
            episode, time, *values = (np.concatenate(column) for column in zip(*self._rows, strict=True))
            for array, played in zip((observations, actions, rewards), values, strict=True):
                array[time, episode] = played
        return Episodes(observations, actions, rewards, lengths, terminated, returns)


def _refuse(
    observations: NDArray[np.float32],
    busy: NDArray[np.bool_],
    numbers: NDArray[np.uint64],
    times: NDArray[np.int64],
) -> None:
    """Raise if a lane that counts sees NaN or infinity."""
    wrong = busy & ~np.isfinite(observations).all(axis=1)
    if wrong.any():
        lane = int(np.argmax(wrong))
        raise FloatingPointError(
            f"the observation at step {times[lane]} of episode {numbers[lane]}, lane {lane}, is not finite"
        )
