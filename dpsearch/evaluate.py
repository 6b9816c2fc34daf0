"""The application that measures a trained policy, and shows it at play: ``dpsearch-evaluate RUN --render``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch

from dpsearch.algos import Evaluation
from dpsearch.algos.base import EVALUATION
from dpsearch.files import CheckpointError
from dpsearch.kernels.philox import episode_seeds, stream_key
from dpsearch.policies import PolicyRunner, RecurrentPolicy
from dpsearch.policies.observations import flattener
from dpsearch.policies.spaces import head_for
from dpsearch.rollout import EnvironmentFailedError
from dpsearch.rollout.base import check_fit
from dpsearch.rollout.recipe import render_modes
from dpsearch.runs import EnvRecipe, RunDirectory, RunError, load_policy
from dpsearch.runs.playback import Film, Gif, Video, play_episode

EPISODES, WATCHED_EPISODES = 100, 3  # unless the command line says otherwise
FILMED_STEPS = 1000  # most steps of an episode: poles that never fall would fill a disk


def main(arguments: Sequence[str] | None = None) -> None:
    """Evaluate the policy that the command line names."""
    options = _parser().parse_args(arguments)
    torch.set_num_threads(1)
    try:
        policy, recipe = load_policy(RunDirectory(options.run).policy if options.run.is_dir() else options.run)
        if recipe.stranger and options.env != recipe.id:
            raise RunError(
                f"{options.run} names environment {recipe.id!r}, for which module {recipe.stranger!r} would be "
                f"imported: if that is meant, give --env {recipe.id}"
            )
        watched = options.render or options.video or options.gif
        if options.steps and not watched:
            raise RunError("--steps is for watching: give --render, --video or --gif too")
        evaluation = watch(policy, recipe, options) if watched else measure(policy, recipe, options)
    except (RunError, CheckpointError, EnvironmentFailedError) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
    print(_report(evaluation, greedy=options.greedy))
    if film := options.video or options.gif:
        print(f"written to {film}")


def measure(policy: RecurrentPolicy, recipe: EnvRecipe, options: argparse.Namespace) -> Evaluation:
    """Measure the policy over episodes that are not shown, which is fast.

    Raises:
        RunError: If the environment cannot be played.
    """
    with closing(recipe.rollouts()) as rollouts:
        _check_fit(policy, recipe, rollouts.observation_space, rollouts.action_space)
        episodes = rollouts.collect(
            policy,
            options.episodes or EPISODES,
            key=stream_key(options.seed, EVALUATION),
            greedy=options.greedy,
            record=False,
        )
    return Evaluation(episodes.returns, episodes.lengths)


def watch(policy: RecurrentPolicy, recipe: EnvRecipe, options: argparse.Namespace) -> Evaluation:
    """Play episodes in a window or for a film.

    Raises:
        RunError: If the environment cannot be drawn, or the film cannot be written.
    """
    mode = "human" if options.render else "rgb_array"
    with closing(recipe.make()) as env:
        _check_fit(policy, recipe, env.observation_space, env.action_space)
        modes = render_modes(env.metadata)
    if not {mode, "rgb_array"} & set(modes):  # Gymnasium can show in a window what is drawn as an array
        raise RunError(f"environment {recipe.id!r} cannot be drawn: its render modes are {modes}")
    no_window: type[Exception] = gym.error.DependencyNotInstalled
    if options.render:
        try:
            import pygame
        except ImportError as error:
            raise RunError('a window needs pygame: pip install "dpsearch[render]"') from error
        no_window = pygame.error
    try:
        return _play(policy, recipe, options, mode)
    except (gym.error.DependencyNotInstalled, no_window) as error:
        raise RunError(f"environment {recipe.id!r} cannot be drawn: {error}") from error


def _check_fit(
    policy: RecurrentPolicy, recipe: EnvRecipe, observation_space: gym.Space[Any], action_space: gym.Space[Any]
) -> None:
    try:
        check_fit(policy, flattener(observation_space).size, head_for(action_space).action_size)
    except (ValueError, TypeError) as error:
        raise RunError(f"the policy does not fit environment {recipe.id!r}: {error}") from error


def _play(policy: RecurrentPolicy, recipe: EnvRecipe, options: argparse.Namespace, mode: str) -> Evaluation:
    count = options.episodes or WATCHED_EPISODES
    seeds = episode_seeds(stream_key(options.seed, EVALUATION), np.arange(count, dtype=np.uint64))
    runner = PolicyRunner(policy, seed=options.seed, greedy=options.greedy)
    played = []
    with closing(recipe.make(mode)) as env:
        steps = options.steps or (FILMED_STEPS if options.video or options.gif else None)
        film = _film(options, env.metadata.get("render_fps", 30))
        for number, seed in enumerate(seeds, 1):
            played.append(play_episode(env, runner, int(seed), film, steps))
            cut = ", not shown further (--steps)" if played[-1][1] == steps else ""
            print(f"episode {number}: return {played[-1][0]:,.6g}, {played[-1][1]} steps{cut}")
        if film is not None:
            film.close()
    returns, lengths = zip(*played, strict=True)
    return Evaluation(np.array(returns), np.array(lengths))


def _film(options: argparse.Namespace, frames_per_second: float) -> Film | None:
    if options.gif:
        return Gif(options.gif, frames_per_second)
    return Video(options.video, frames_per_second) if options.video else None


def _report(evaluation: Evaluation, *, greedy: bool) -> str:
    returns, lengths = evaluation.returns, evaluation.lengths
    error = f" ± {round(evaluation.standard_error, 9):.2g}" if len(returns) > 1 else ""
    return "\n".join(
        [
            f"{len(returns)} episode{'s' * (len(returns) > 1)} of the {'greedy' if greedy else 'stochastic'} policy",
            f"return: mean {evaluation.mean_return:,.6g}{error}, median {np.median(returns):,.6g}, "
            f"from {returns.min():,.6g} to {returns.max():,.6g}",
            f"length: mean {evaluation.mean_length:,.6g}, median {np.median(lengths):,.6g}, "
            f"from {lengths.min()} to {lengths.max()}",
        ]
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="dpsearch-evaluate", description="Say what a trained policy achieves, and show it."
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="directory of a run, or a policy.pt")
    parser.add_argument("--env", metavar="ID", help="the environment's id, if a module of yours has it")
    parser.add_argument(
        "--episodes",
        type=_positive,
        metavar="N",
        help=f"episodes to play ({EPISODES}; {WATCHED_EPISODES} to watch)",
    )
    parser.add_argument("--greedy", action="store_true", help="the most probable actions, not sampled ones")
    parser.add_argument("--seed", type=_seed, default=0, metavar="K", help="of everything random (0)")
    parser.add_argument(
        "--steps",
        type=_positive,
        metavar="M",
        help=f"steps of an episode to watch ({FILMED_STEPS} in a film; all in a window)",
    )
    show = parser.add_mutually_exclusive_group()
    show.add_argument("--render", action="store_true", help="watch in a window")
    show.add_argument("--video", type=Path, metavar="FILE", help="make a video, such as policy.mp4")
    show.add_argument("--gif", type=Path, metavar="FILE", help="make an animated GIF")
    return parser


def _whole(text: str) -> int:
    try:
        return int(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"must be a whole number, got {text!r}") from error


def _positive(text: str) -> int:
    number = _whole(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1, got {number}")
    return number


def _seed(text: str) -> int:
    number = _whole(text)
    if not 0 <= number < 2**64:
        raise argparse.ArgumentTypeError(f"must be in [0, 2**64), got {number}")
    return number


if __name__ == "__main__":
    main()
