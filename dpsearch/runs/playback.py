"""Playing episodes of a policy to watch: in a window, as an animated GIF, or as a video."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dpsearch.errors import RunError
from dpsearch.policies import PolicyRunner
from dpsearch.policies.observations import flattener
from dpsearch.policies.spaces import to_env_actions

Frame = NDArray[np.uint8]
LAST_FRAME_SECONDS = 1.0  # how long an episode's end stays in sight


class Film(Protocol):
    """A file that frames are added to."""

    frames_per_second: float

    def add(self, frame: Frame) -> None:
        """Append a frame ``(height, width, 3)``."""

    def close(self) -> None:
        """Finish the file."""


def play_episode(
    env: gym.Env[Any, Any], runner: PolicyRunner, seed: int, film: Film | None = None, max_steps: int | None = None
) -> tuple[float, int]:
    """Play one episode; returns its return and its number of steps.

    Args:
        env: The environment; to be filmed, it needs the render mode "rgb_array".
        runner: The policy that acts.
        seed: Seed of the environment's reset.
        film: File for frames: one of the start and of every step, and several of the end. None films nothing.
        max_steps: Number of steps after which the episode is left unfinished.
    """
    flatten = flattener(env.observation_space)
    observation, _ = env.reset(seed=seed)
    runner.reset()
    _shoot(env, film)
    total, steps, over = 0.0, 0, False
    while not over:
        action = to_env_actions(env.action_space, runner.act(flatten.one(observation)[None]))[0]
        observation, reward, terminated, truncated, _ = env.step(action)
        total += float(reward)
        steps += 1
        over = terminated or truncated or steps == max_steps
        _shoot(env, film)
    if film is not None:
        _shoot(env, film, round(LAST_FRAME_SECONDS * film.frames_per_second))
    return total, steps


def _shoot(env: gym.Env[Any, Any], film: Film | None, times: int = 1) -> None:
    if film is not None:
        frame: Any = env.render()
        for _ in range(times):
            film.add(frame)


class Gif:
    """An animated GIF.

    Args:
        path: The file.
        frames_per_second: Speed; viewers go no faster than 50.

    Raises:
        RunError: If the file cannot be written.
    """

    def __init__(self, path: Path, frames_per_second: float) -> None:
        self._path = path
        self.frames_per_second = min(frames_per_second, 50.0)
        self._frames: list[Image.Image] = []
        _claim(path)

    def add(self, frame: Frame) -> None:
        """Append a frame, in 256 colours."""
        image = Image.fromarray(frame)
        self._frames.append(image.quantize(256, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE))

    def close(self) -> None:
        """Write the file."""
        first, *rest = self._frames
        milliseconds = round(1000 / self.frames_per_second)
        first.save(self._path, "GIF", save_all=True, append_images=rest, duration=milliseconds, loop=0)


class Video:
    """A video in the format of the file's extension.

    Args:
        path: The file.
        frames_per_second: Speed.

    Raises:
        RunError: If the file cannot be written, or imageio or ffmpeg is missing or knows no such format.
    """

    def __init__(self, path: Path, frames_per_second: float) -> None:
        if find_spec("imageio") is None or find_spec("imageio_ffmpeg") is None:
            raise RunError('videos need imageio and ffmpeg: pip install "dpsearch[video]"')
        import imageio.v2 as imageio

        self.frames_per_second = frames_per_second
        # sizes are rounded up to even numbers, which is all that the usual codec asks for
        options = {"format": "FFMPEG", "fps": frames_per_second, "macro_block_size": 2}
        try:
            self._writer = imageio.get_writer(path, **options)  # type: ignore[arg-type]
        except RuntimeError as error:
            raise RunError(f"there is no video format for {path}: try a name that ends in .mp4") from error
        except OSError as error:
            raise RunError(f"cannot write {path}: {error.strerror or error}") from error
        _claim(path)

    def add(self, frame: Frame) -> None:
        """Append a frame."""
        self._writer.append_data(frame)

    def close(self) -> None:
        """Finish the file."""
        self._writer.close()


def _claim(path: Path) -> None:
    """Make sure before the first episode, not after the last, that a file can be written."""
    try:
        open(path, "ab").close()
    except OSError as error:
        raise RunError(f"cannot write {path}: {error.strerror}") from error
