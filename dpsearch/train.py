"""The application that trains: ``python train.py algo=rpg env=tmaze``, or ``dpsearch-train`` once installed."""

from __future__ import annotations

import math
import os
import re
import shlex
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import fields
from datetime import datetime
from pathlib import Path
from signal import Signals
from traceback import walk_tb
from typing import Any

import hydra
import torch
from hydra.conf import HydraConf
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import ConfigAttributeError, ConfigKeyError, OmegaConfBaseException

from dpsearch import config as schema
from dpsearch.algos import ALGORITHMS, Algorithm
from dpsearch.algos.memory import memory_errors
from dpsearch.config import TrainConfig
from dpsearch.files import CheckpointError
from dpsearch.help import page
from dpsearch.policies import UnsupportedSpaceError
from dpsearch.rollout import EnvironmentFailedError, EnvRecipe, Rollouts
from dpsearch.runs import Limits, Run, RunDirectory, RunError
from dpsearch.runs.booleans import check_booleans
from dpsearch.runs.resumption import check_unchanged

FULL_ERROR = "HYDRA_FULL_ERROR"
TRACEBACKS = os.environ.get(FULL_ERROR) == "1"  # asked for, even where one line would do

_failed: list[str] = []  # jobs of this sweep

schema.register()


def main() -> None:
    """Compose the configuration from the command line, and train."""
    os.environ[FULL_ERROR] = "1"  # Hydra then leaves its errors to us
    _failed.clear()
    try:
        with _warnings_in_one_line(), _errors_in_one_line():
            if {"--help", "-h"} & set(sys.argv[1:]):
                print(page([argument for argument in sys.argv[1:] if not argument.startswith("-")]), flush=True)
            else:
                _application()
            if _failed:
                raise RunError(f"of the sweep, these jobs failed: {', '.join(_failed)}")
    except BrokenPipeError:  # whoever reads the help has seen enough; nothing is left to be written at the exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except KeyboardInterrupt:
        sys.exit(130)
    except Exception as error:
        ours = any(frame.f_code is _application.__wrapped__.__code__ for frame, _ in walk_tb(error.__traceback__))
        if TRACEBACKS or ours:
            raise
        print(f"error: {_one_line(error)}", file=sys.stderr)  # Hydra's, of what the command line says
        sys.exit(2)


@hydra.main(config_path="pkg://dpsearch.configs", config_name="train", version_base="1.3")
def _application(config: DictConfig) -> None:
    hydra_config = HydraConfig.get()
    sweep = hydra_config.mode == RunMode.MULTIRUN
    with _errors_in_one_line():  # here too: Hydra adds a line to what it sees
        if sweep and config.run_dir and not OmegaConf.is_interpolation(config, "run_dir"):
            raise RunError(
                "run_dir is one directory, and a sweep needs several: leave it out, or say 'run_dir=X/${seed}'"
            )
    job = f"job {hydra_config.job.num} ({hydra_config.job.override_dirname})" if sweep else ""
    try:
        with _errors_in_one_line(job):
            train(config, hydra_config)
    except SystemExit as end:
        if not sweep or end.code != 2:
            raise
        _failed.append(str(hydra_config.job.num))  # the others may do better


def train(config: DictConfig, hydra_config: HydraConf) -> None:
    """Begin a run, or go on with one, and bring it to its end.

    Args:
        config: The composed configuration; see ``TrainConfig``.
        hydra_config: Hydra's own configuration.

    Raises:
        RunError: If that cannot be done.
        CheckpointError: If the run to go on with has no checkpoint that can be read.
        SystemExit: If a signal ended it, once the checkpoint is written.
    """
    torch.set_num_threads(1)  # fastest at these sizes; and nothing may depend on how many there are
    resumed = None if config.resume is None else RunDirectory.named("resume", config.resume)
    if resumed is None:
        choices = dict(hydra_config.runtime.choices)
    else:
        config, choices = _saved(resumed, config, list(hydra_config.overrides.task))
    overrides = [] if resumed else list(hydra_config.overrides.task)
    given, config = config, schema.completed(config, choices, overrides)
    settings = schema.checked(config)
    check_booleans(given, settings)
    decisive = _decisive(config)
    checksum = check_unchanged(resumed, decisive) if resumed is not None and resumed.has_begun else None
    recipe = settings.env.recipe()
    rollouts = _rollouts(recipe, settings)
    limits = _limits(settings, rollouts)
    algorithm = _algorithm(ALGORITHMS[choices["algo"]], settings, recipe, rollouts, resumed)
    directory = resumed or _new_directory(settings, choices)
    if resumed is None:
        directory.begin(config, hydra_config)
    try:
        with Run(
            directory,
            algorithm,
            recipe,
            limits,
            settings=decisive,
            metrics_checksum=checksum,
            checkpoint_seconds=settings.checkpoint_seconds,
            progress=settings.progress,
        ) as run:
            directory.write_config(config)  # the limits may be new
            limit = f"episodes of at most {rollouts.max_steps:,} steps"
            print(f"{algorithm.name} on {recipe.id}, {limit}, seed {algorithm.seed}: {directory.path}", file=sys.stderr)
            outcome = run.learn() or run.finish(settings.evaluation_episodes)
    except (FloatingPointError, MemoryError) as error:
        raise RunError(f"{error}; the run so far is in {directory.path}") from error
    except EnvironmentFailedError as error:
        resume = _command(f"resume={directory.path}", "rollout.on_error=retry")
        raise RunError(
            f"{error}; the run so far is in {directory.path}, and goes on past episodes that fail with: {resume}"
        ) from error
    except OSError as error:  # the disk is full, or a simulator was ended
        resume = _command(f"resume={directory.path}")
        raise RunError(f"{error}; the run so far is in {directory.path}, and goes on with: {resume}") from error
    if isinstance(outcome, Signals):
        resume = _command(f"resume={directory.path}")
        with suppress(OSError):  # after SIGHUP, there may be no terminal any more
            print(f"{outcome.name} after update {algorithm.updates}; to go on: {resume}", file=sys.stderr)
        sys.exit(128 + outcome)
    print(_report(directory, outcome, recipe))


def _saved(directory: RunDirectory, asked: DictConfig, overrides: list[str]) -> tuple[DictConfig, dict[str, str]]:
    """A run's configuration with what may be changed of it, and the option chosen of each group."""
    keys = [override.partition("=")[0].lstrip("+~") for override in overrides]
    refused = [key for key in keys if key not in schema.RESUMABLE]
    if refused:
        allowed = ", ".join(sorted(schema.RESUMABLE - {"resume"}))
        raise RunError(f"{refused[0]} cannot be changed when a run is resumed, only {allowed} can")
    config, choices = directory.read_config()
    for key in set(keys) - {"resume"}:
        OmegaConf.update(config, key, OmegaConf.select(asked, key))
    return config, choices


def _new_directory(settings: TrainConfig, choices: dict[str, str]) -> RunDirectory:
    if settings.run_dir is not None:
        return RunDirectory.named("run_dir", settings.run_dir)
    env = choices["env"]
    if env == "gym":  # says little
        env = re.sub(r"[^\w.-]+", "-", settings.env.id.rpartition(":")[2])
    name = f"{datetime.now():%Y-%m-%d_%H-%M-%S}_seed{settings.seed}"
    return RunDirectory.free(Path("runs") / choices["algo"] / env / name)


def _limits(settings: TrainConfig, rollouts: Rollouts) -> Limits:
    limits = Limits(
        settings.total_steps,
        settings.total_episodes,
        settings.total_updates,
        until_solved=settings.until_solved and rollouts.reward_threshold is not None,
    )
    if limits == Limits():
        raise RunError(
            "nothing would end this run: give total_steps, total_episodes or total_updates; "
            "until_solved ends it only if the environment has a reward threshold"
        )
    return limits


def _rollouts(recipe: EnvRecipe, settings: TrainConfig) -> Rollouts:
    try:
        return recipe.rollouts(**vars(settings.rollout))
    except RunError as error:
        cause = error.__cause__ or error
        if (refused := _in_full(cause, env=settings.env, rollout=settings.rollout)) != str(cause):
            raise RunError(refused) from error
        raise


def _in_full(error: BaseException, **sections: Any) -> str:
    """An error's message; if it begins with the name of a setting in one of the sections, with its full name."""
    message = str(error)
    keys = {key.name: f"{section}." for section, values in sections.items() for key in fields(values)}
    setting = re.split("[ .]", message, maxsplit=1)[0]  # baseline, of baseline.optimizer_options
    return keys.get(setting, "") + message


def _algorithm(
    kind: type[Algorithm[Any]],
    settings: TrainConfig,
    recipe: EnvRecipe,
    rollouts: Rollouts,
    resumed: RunDirectory | None,
) -> Algorithm[Any]:
    """The algorithm as the checkpoint has it, or a new one."""
    if resumed is not None and resumed.has_begun:
        try:
            return kind.load(resumed.checkpoint, env=rollouts, recipe=recipe)
        except OSError as error:  # a simulator does not start, or ends while the episode is played up to where it was
            raise RunError(str(error)) from error
    try:
        with memory_errors():
            return kind(rollouts, settings.algo, policy=settings.policy, seed=settings.seed, recipe=recipe)
    except (UnsupportedSpaceError, ValueError, TypeError, OverflowError, MemoryError) as error:
        raise RunError(_in_full(error, policy=settings.policy, algo=settings.algo)) from error


def _decisive(config: DictConfig) -> dict[str, Any]:
    """The settings that decide what a run learns, as plain values."""
    plain = OmegaConf.to_container(config, resolve=True)
    assert isinstance(plain, dict)
    own = {str(key): plain[key] for key in ("algo", "env", "policy", "seed")}
    return {**own, "rollout": {"num_envs": plain["rollout"]["num_envs"]}}


def _command(*arguments: str) -> str:
    """The command that calls this application with other arguments."""
    program = "python train.py" if Path(sys.argv[0]).name == "train.py" else "dpsearch-train"
    return f"{program} {shlex.join(arguments)}"


def _report(directory: RunDirectory, summary: dict[str, Any], recipe: EnvRecipe) -> str:
    """The lines that a finished run prints."""
    threshold, path = summary["reward_threshold"], shlex.quote(str(directory.path))
    achieved = [
        f"{_number(summary[f'return_{kind}'], ',.6g')} ± {_number(summary[f'return_{kind}_se'], '.2g')} {kind}"
        for kind in ("stochastic", "greedy")
    ]
    if threshold is not None:
        elsewhere = summary["solved"] and (summary["return_stochastic"] or -math.inf) < threshold
        judged = ", judged in training by other episodes" if elsewhere else ""
        achieved.append(f"{'solved' if summary['solved'] else 'not solved'} (threshold {threshold:g}{judged})")
    foreign = "" if recipe.id.rpartition(":")[0] in ("", "dpsearch.envs") else f" --env {shlex.quote(recipe.id)}"
    return "\n".join(
        [
            f"{summary['updates']:,} updates, {summary['episodes']:,} episodes, "
            f"{summary['env_steps']:,} environment steps in {summary['wall_time_s']:.1f} s",
            f"mean return of {summary['evaluation_episodes']} episodes: {', '.join(achieved)}",
            *([f"watch it:   dpsearch-evaluate {path}{foreign} --render"] if recipe.drawable else []),
            f"see curves: tensorboard --logdir {path}",
        ]
    )


def _number(value: float | None, form: str) -> str:
    return "NaN or infinite" if value is None else format(round(value, 9), form)


@contextmanager
def _warnings_in_one_line() -> Iterator[None]:
    """Show warnings without the line of code that gave them."""
    before = warnings.formatwarning
    warnings.formatwarning = lambda message, *_, **__: f"warning: {message}\n"
    try:
        yield
    finally:
        warnings.formatwarning = before


@contextmanager
def _errors_in_one_line(job: str = "") -> Iterator[None]:
    """Turn the errors that are the user's to mend into one line, which names the job of a sweep, and exit code 2."""
    try:
        yield
    except (RunError, CheckpointError, HydraException, OmegaConfBaseException) as error:
        if TRACEBACKS:
            raise
        print(f"error: {f'{job}: ' if job else ''}{_one_line(error)}", file=sys.stderr)
        sys.exit(2)


def _one_line(error: Exception) -> str:
    """A message in one line: Hydra and OmegaConf put causes, details and hints on several."""
    cause = error.__cause__ if isinstance(error.__cause__, OmegaConfBaseException) else None
    if isinstance(cause, ConfigAttributeError | ConfigKeyError) and cause.full_key == cause.key:  # of the run itself
        return schema.unknown(str(cause.key), [setting.name for setting in fields(TrainConfig)])
    message = str(error) if cause is None else f"{error}\n{cause}"
    lines = [line.strip().removeprefix("In 'train': ") for line in message.splitlines()]
    if "Config search path:" in lines:
        lines = lines[: lines.index("Config search path:")]
    where = [line.removeprefix("full_key: ") for line in lines if line.startswith("full_key: ")]
    noise = ("To append to", "full_key: ", "reference_type=", "object_type=", "See https:")
    said = [line for line in lines if line and not line.startswith(noise)]
    return ": ".join(line.rstrip(".:") for line in (said if cause else where + said))
