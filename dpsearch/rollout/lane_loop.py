"""The lane engine's inner loop: blocks of episodes in lock-step, refilled from a queue that threads share.

One function, compiled on demand for each kind of weights: one vector for all lanes (``collect``: one policy, many
episodes), in single or double precision, or a different candidate's in every lane (``evaluate``: many policies). A lane
that finishes takes the next job at once. All randomness is keyed by the job's episode number, so the outcome does not
depend on which lane or thread plays it.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numba.extending import overload

from dpsearch.kernels.lanes import (
    FLOATS,
    FORWARD_LANES,
    FORWARD_SHARED,
    FORWARD_SINGLE,
    LANES,
    OBSERVE,
    RESET,
    ROWS,
    SAMPLE,
    SINGLES,
    STEP,
    WIDTH,
    fetch_add,
    function_at,
)
from dpsearch.kernels.on_demand import on_demand
from dpsearch.kernels.philox import ACTION, ENVIRONMENT, draw
from dpsearch.policies.compiled import remember_action

_IDLE = -1
_reset_at, _observe_at, _step_at, _sample_at = map(function_at, (RESET, OBSERVE, STEP, SAMPLE))
_FORWARD_AT = {
    weights: function_at(signature)
    for weights, signature in ((SINGLES, FORWARD_SINGLE), (FLOATS, FORWARD_SHARED), (ROWS, FORWARD_LANES))
}


def _forward_at(address: Any, weights: Any) -> Any:
    """The forward pass at an address, for weights of a kind."""


@overload(_forward_at, inline="always")
def _forward_by_weights(address, weights):
    at = _FORWARD_AT[weights]
    return lambda address, weights: at(address)


def _load(weights, population, candidate, lane):
    """Put a candidate's weights into its lane; nothing to do where all lanes share one vector."""


@overload(_load, inline="always")
def _load_by_layout(weights, population, candidate, lane):
    def shared(weights, population, candidate, lane):
        pass

    def per_lane(weights, population, candidate, lane):
        for i in range(weights.shape[0]):
            weights[i, lane] = population[candidate, i]

    return shared if weights.ndim == 1 else per_lane


@njit(inline="always")
def _close_up(job, episode, time, total, state, hidden, weights, population, candidates, fewer, lanes):
    """Moves what is played in the last lanes to where nothing is, so that fewer lanes hold it all."""
    free = 0
    for lane in range(fewer, lanes):
        if job[lane] != _IDLE:
            while job[free] != _IDLE:
                free += 1
            job[free], episode[free], time[free], total[free] = job[lane], episode[lane], time[lane], total[lane]
            state[:, free] = state[:, lane]
            hidden[:, free] = hidden[:, lane]
            _load(weights, population, candidates[job[free]], free)  # type: ignore[no-untyped-call]
            job[lane] = _IDLE


@on_demand()
def play(
    env_functions,  # addresses: reset, observe, step
    floats,
    ints,
    env_rows,  # state, observation, action, noise
    policy_functions,  # addresses: forward, sample
    policy_sizes,
    head_sizes,
    policy_rows,  # hidden, scratch, output, noise
    weights,  # (P,) or (P, LANES)
    population,  # (N, P), read when weights are (P, LANES)
    key,
    episodes,  # (E,): the episode number of each job
    candidates,  # (E,): whose weights play it
    max_steps,
    queue,  # (1,): the next job, shared by all threads
    observations,  # (T, E, O), or T = 0 to record nothing
    actions,  # (T, E, A)
    rewards,  # (T, E)
    returns,  # (E,)
    lengths,  # (E,)
    terminated,  # (E,)
):
    """Play jobs from the queue until it is empty, in one block of lanes.

    Weights and population are float32 or float64, what is recorded float32, sizes, lengths and candidates int64, key
    and episodes uint64, ``terminated`` bool, and all other arrays float64; all are C-contiguous.
    """
    reset, observe, step = _reset_at(env_functions[0]), _observe_at(env_functions[1]), _step_at(env_functions[2])
    forward, sample = _forward_at(policy_functions[0], weights), _sample_at(policy_functions[1])
    state = np.zeros((env_rows[0], LANES))
    observation = np.zeros((env_rows[1], LANES))
    action = np.zeros((env_rows[2], LANES))
    env_noise = np.zeros((env_rows[3], LANES))
    hidden = np.zeros((policy_rows[0], LANES), weights.dtype)
    scratch = np.zeros((policy_rows[1], LANES), weights.dtype)
    output = np.zeros((policy_rows[2], LANES))
    action_noise = np.zeros((policy_rows[3], LANES))
    reward = np.zeros(LANES)
    ended = np.zeros(LANES, np.bool_)
    job = np.full(LANES, _IDLE)
    episode = np.zeros(LANES, np.uint64)
    time = np.zeros(LANES, np.int64)
    total = np.zeros(LANES)
    record = rewards.shape[0] > 0
    n_jobs = episodes.shape[0]
    busy, lanes = 0, LANES  # those beyond are idle for good
    exhausted = False
    while True:
        if busy < LANES and not exhausted:
            fresh = np.zeros(LANES, np.bool_)
            for lane in range(LANES):
                if job[lane] == _IDLE and not exhausted:
                    taken = fetch_add(queue)
                    if taken >= n_jobs:
                        exhausted = True
                    else:
                        job[lane], episode[lane], time[lane], total[lane] = taken, episodes[taken], 0, 0.0
                        fresh[lane] = True
                        busy += 1
                        hidden[:, lane] = 0.0
                        _load(weights, population, candidates[taken], lane)  # type: ignore[no-untyped-call]
            draw(key, episode, time, ENVIRONMENT, env_noise, LANES)
            for lane in range(LANES):
                if fresh[lane]:
                    reset(floats, ints, env_noise, lane, state)
        if busy == 0:
            return
        if busy <= lanes - WIDTH:  # nothing is left to fill them with
            fewer = WIDTH * ((busy + WIDTH - 1) // WIDTH)
            _close_up(job, episode, time, total, state, hidden, weights, population, candidates, fewer, lanes)
            lanes = fewer
        observe(floats, ints, state, observation, lanes)
        forward(policy_sizes, weights, observation, hidden, scratch, output, lanes)
        draw(key, episode, time, ACTION, action_noise, lanes)
        sample(head_sizes, action_noise, output, action, lanes)
        remember_action(policy_sizes, head_sizes, output, action, hidden)
        for lane in range(lanes):
            time[lane] += 1
        draw(key, episode, time, ENVIRONMENT, env_noise, lanes)
        step(floats, ints, env_noise, action, state, reward, ended, lanes)
        for lane in range(lanes):
            if job[lane] == _IDLE:
                continue
            total[lane] += reward[lane]
            if record:
                t, column = np.uint64(time[lane] - 1), np.uint64(job[lane])  # unsigned: no tests for negative indices
                for i in range(observation.shape[0]):
                    observations[t, column, np.uint64(i)] = observation[i, lane]
                for i in range(action.shape[0]):
                    actions[t, column, np.uint64(i)] = action[i, lane]
                rewards[t, column] = reward[lane]
            if ended[lane] or time[lane] >= max_steps:
                returns[job[lane]] = total[lane]
                lengths[job[lane]] = time[lane]
                terminated[job[lane]] = ended[lane]
                job[lane] = _IDLE
                busy -= 1
