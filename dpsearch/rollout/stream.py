"""One environment played on and on, in pieces: for tasks that are learned while they go on.

::

    episode 0          episode 1                              episode 2
    |---------------|  |---------------------------------|    |--------- ...
    |     play(1000)      |        play(1000)       |       play(1000)
      piece    piece 2         piece                  piece   piece

A call plays so many steps, and cuts what it played where episodes end and at its own end; the recurrent state is
carried on from there to the next call. A new episode is begun with what the one before says in ``info["carry_on"]``,
if anything: a car is put back where it left the road.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from typing_extensions import override

from dpsearch.kernels.philox import episode_seeds
from dpsearch.policies.observations import flattener
from dpsearch.policies.policy import RecurrentPolicy
from dpsearch.policies.spaces import to_env_actions
from dpsearch.rollout.actor import LaneActor
from dpsearch.rollout.base import EnvironmentFailedError, Rollouts, check_fit
from dpsearch.rollout.episodes import Episodes
from dpsearch.rollout.gym_lanes import as_reward


@dataclass(frozen=True)
class Pieces(Episodes):
    """N pieces of a stream, one after the other, as columns.

    A piece that the task did not end goes on, so row ``lengths[n]`` of its observations is what is seen next: arrays
    have T rows where the longest piece has T - 1 or T steps.

    Attributes:
        memory: ``(N, state_size)`` float32, the recurrent state before the first step of each.
        finished: ``(K,)`` float64, undiscounted returns of the whole episodes that ended.
        begins: Whether an episode begins with the first piece; one does with all others.
    """

    memory: NDArray[np.float32]
    finished: NDArray[np.float64]
    begins: bool

    @property
    @override
    def state(self) -> NDArray[np.float32]:
        return self.memory

    @property
    @override
    def count(self) -> int:
        return 1  # one sum over all steps of the stream

    @property
    @override
    def goes_on(self) -> bool:
        return not bool(self.terminated.all())

    @property
    @override
    def seen(self) -> NDArray[np.int64]:
        return self.lengths + ~self.terminated

    @override
    def returns_to_go(self, gamma: float, expected: NDArray[np.float32] | float | None = None) -> NDArray[np.float32]:
        rewards = self.rewards.copy()
        cut = np.flatnonzero(~self.terminated)
        after = np.broadcast_to(0.0 if expected is None else expected, rewards.shape)
        rewards[self.lengths[cut], cut] = after[self.lengths[cut], cut]  # as if it were paid, all at once
        returns = self.discounted(rewards, gamma, self.seen)
        returns[self.lengths[cut], cut] = 0.0
        return returns


class Stream:
    """Plays one environment on and on.

    Episode k is seeded by (key, k), as it is by the engines. The environment must be a function of its seeds, options
    and actions, or a stream cannot be picked up again where it was left.

    Args:
        rollouts: What else plays the environment, and knows how to make one more.
        key: 64-bit key of the randomness.

    Raises:
        ValueError: If the environment came ready made, or failed episodes are to be played again.
    """

    def __init__(self, rollouts: Rollouts, key: int) -> None:
        if getattr(rollouts, "on_error", "raise") != "raise":
            raise ValueError("on_error must be 'raise' for a stream, which cannot play an episode again")
        if rollouts.make_env is None:
            raise ValueError(
                "update_steps needs an environment of its own: give an id or a factory, not one that is made already"
            )
        self._rollouts = rollouts
        self._key = key
        self._env = rollouts.make_env()
        self._flatten = flattener(rollouts.observation_space)
        self._episode = -1  # none yet
        self._options: dict[str, Any] | None = None  # of its reset
        self._actions: list[NDArray[np.float64]] = []  # since then
        self._observation = np.zeros(rollouts.observation_size, np.float32)
        self._memory: NDArray[np.floating] | None = None  # None: an episode begins
        self._return = 0.0

    def play(self, policy: RecurrentPolicy, steps: int) -> Pieces:
        """The next steps.

        Args:
            policy: Whose actions to take.
            steps: How many, at least 1.

        Raises:
            ValueError: If the policy does not fit the environment.
            EnvironmentFailedError: If the environment raises, or shows or pays what is not a finite number of the right
                shape.
        """
        action_space, size = self._rollouts.action_space, policy.head.action_size
        check_fit(policy, self._rollouts.observation_size, size)
        actor = LaneActor(policy, policy.vector(), 1, self._key, greedy=False)
        observations = np.empty((steps + 1, policy.observation_size), np.float32)
        actions, rewards = np.empty((steps, size), np.float32), np.empty(steps, np.float32)
        if self._episode < 0:
            self._begin(None)
        begins = self._memory is None
        self._take_up(actor)
        ends: list[int] = []
        terminated: list[bool] = []
        finished: list[float] = []
        following: dict[int, NDArray[np.float32]] = {}
        memories = [actor.memory[0]]
        for t in range(steps):
            observations[t] = self._observation
            action = actor.act(self._observation[None])
            self._actions.append(action[0].copy())
            with self._failing():
                observation, paid, over, truncated, info = self._env.step(to_env_actions(action_space, action)[0])
                reward = as_reward(paid)
                self._see(observation)
                if not math.isfinite(reward):
                    raise FloatingPointError("the reward is not finite")
            actions[t], rewards[t] = action[0], reward
            self._return += float(reward)
            if over or truncated:
                following[len(ends)] = self._observation
                ends.append(t + 1)
                terminated.append(bool(over))
                finished.append(self._return)
                self._begin(info.get("carry_on"))
                self._take_up(actor)
                memories.append(actor.memory[0])
        if not ends or ends[-1] < steps:
            following[len(ends)] = self._observation
            ends.append(steps)
            terminated.append(False)
        self._memory = actor.memory[0] if self._actions else None
        return _cut(observations, actions, rewards, ends, terminated, following, memories, finished, begins)

    def _begin(self, options: Mapping[str, Any] | None) -> None:
        """Start the next episode."""
        self._episode += 1
        self._options = None if options is None else dict(options)
        self._actions.clear()
        self._memory, self._return = None, 0.0
        self._reset()

    def _reset(self) -> None:
        (seed,) = episode_seeds(self._key, np.array([self._episode], np.uint64))
        with self._failing():
            observation, _ = self._env.reset(seed=int(seed), options=self._options)
            self._see(observation)

    def _see(self, observation: Any) -> None:
        self._observation = self._flatten.one(observation).copy()
        if not np.isfinite(self._observation).all():
            raise FloatingPointError("the observation is not finite")

    @contextmanager
    def _failing(self) -> Iterator[None]:
        """Say where an environment failed, whatever it raised."""
        try:
            yield
        except Exception as error:
            where = f"step {len(self._actions)} of episode {self._episode}"
            what = str(error) if isinstance(error, FloatingPointError) else f"{type(error).__name__}: {error}"
            raise EnvironmentFailedError(f"the environment failed at {where}: {what}") from error

    def _take_up(self, actor: LaneActor) -> None:
        """Put an actor where the stream is."""
        actor.begin(np.zeros(1, np.int64), np.array([self._episode], np.uint64), np.zeros(1, np.int64))
        if self._memory is not None:
            actor.resume(self._memory[None], len(self._actions))

    def close(self) -> None:
        """Close the environment."""
        self._env.close()

    def state_dict(self) -> dict[str, Any]:
        """The position of the stream: the episode, how it began, and all actions since."""
        return {
            "episode": self._episode,
            "options": self._options,
            "actions": torch.from_numpy(np.array(self._actions)),
            "memory": None if self._memory is None else torch.from_numpy(self._memory),
            "observation": torch.from_numpy(self._observation),
            "return": self._return,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go to where ``state_dict`` was taken, by doing the same again.

        Raises:
            ValueError: If that does not lead there, since the environment is another one or not deterministic.
        """
        self._episode, self._options = state["episode"], state["options"]
        self._actions = list(state["actions"].numpy())
        self._memory = None if state["memory"] is None else state["memory"].numpy()
        self._return = state["return"]
        if self._episode < 0:
            return
        self._reset()
        for action in self._actions:
            observation, *_ = self._env.step(to_env_actions(self._rollouts.action_space, action[None])[0])
        if self._actions:
            self._see(observation)
        if not np.array_equal(self._observation, state["observation"].numpy()):
            raise ValueError("the environment does not come to the same place when it is played again")


def _cut(
    observations: NDArray[np.float32],
    actions: NDArray[np.float32],
    rewards: NDArray[np.float32],
    ends: list[int],
    terminated: list[bool],
    following: dict[int, NDArray[np.float32]],
    memories: list[NDArray[np.floating]],
    finished: list[float],
    begins: bool,
) -> Pieces:
    """Steps in a row, as columns that end before the steps ``ends``; ``following`` says what was seen there."""
    n, lengths = len(ends), np.diff([0, *ends])
    rows = int((lengths + ~np.array(terminated)).max())
    seen, taken, paid = (np.zeros((rows, n, *part.shape[1:]), np.float32) for part in (observations, actions, rewards))
    for piece, (end, length) in enumerate(zip(ends, lengths, strict=True)):
        for column, part in zip((seen, taken, paid), (observations, actions, rewards), strict=True):
            column[:length, piece] = part[end - length : end]
        if not terminated[piece]:
            seen[length, piece] = following[piece]
    return Pieces(
        seen,
        taken,
        paid,
        lengths=lengths,
        terminated=np.array(terminated),
        returns=paid.sum(0, dtype=np.float64),
        memory=np.array(memories[:n], np.float32),
        finished=np.array(finished),
        begins=begins,
    )
