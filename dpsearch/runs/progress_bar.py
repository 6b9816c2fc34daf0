"""The progress of a run: a bar on a terminal, else a line now and then."""

from __future__ import annotations

import shutil
import sys
from contextlib import suppress
from time import perf_counter
from typing import Any

from tqdm import tqdm

from dpsearch.algos import Algorithm
from dpsearch.kernels import machine_code
from dpsearch.runs.limits import Limits

LINE_SECONDS = 10.0  # between two lines, where there is no terminal


class Progress:
    """Shows steps, steps per second, return and time left on stderr.

    Args:
        algorithm: The algorithm that learns.
        limits: Limits of the run.
        show: Whether to show anything.
    """

    def __init__(self, algorithm: Algorithm[Any], limits: Limits, *, show: bool = True) -> None:
        self._algorithm = algorithm
        self._limits = limits
        self._lines = show and not sys.stderr.isatty()
        self._start = perf_counter()
        self._start_steps, self._start_fraction = algorithm.env_steps, limits.fraction(algorithm)
        self._next_line = self._start + LINE_SECONDS
        tqdm.monitor_interval = 0  # no thread
        columns, lines = shutil.get_terminal_size()  # not tqdm's: it shows nothing where a terminal says 0 x 0
        self._bar = tqdm(
            initial=algorithm.env_steps,
            total=limits.total_steps,
            unit=" steps",
            unit_scale=True,
            ncols=columns,
            nrows=lines,
            delay=1e-9,  # not before the first update
            disable=not show or self._lines,
        )
        self._compiling = False
        if not self._bar.disable:
            machine_code.listeners.append(self._say_that_it_compiles)

    def update(self, now: float) -> None:
        """Show the present progress; nothing more once the terminal, or who read it, is gone.

        Args:
            now: Time by ``perf_counter`` (s).
        """
        try:
            self._show(now)
        except OSError:
            self._bar.disable, self._lines = True, False

    def close(self) -> None:
        """End the bar, and leave it on the screen."""
        if self._say_that_it_compiles in machine_code.listeners:
            machine_code.listeners.remove(self._say_that_it_compiles)
        with suppress(OSError):
            self._bar.close()

    def _say_that_it_compiles(self, kernel: str) -> None:
        """Say on a terminal, once, that kernels are being compiled."""
        if not self._compiling:
            self._compiling = True
            with suppress(OSError):
                tqdm.write("compiling for this processor, once: this takes up to a minute", file=sys.stderr)

    def _show(self, now: float) -> None:
        if not self._bar.disable:
            steps, fraction = self._algorithm.env_steps, self._limits.fraction(self._algorithm)
            self._bar.total = round(steps / fraction) if fraction else None
            self._bar.set_postfix_str(self._algorithm.headline, refresh=False)
            self._bar.update(steps - self._bar.n)
        elif self._lines and now >= self._next_line:
            self._next_line = now + LINE_SECONDS
            print(self._line(now - self._start), file=sys.stderr, flush=True)

    def _line(self, elapsed: float) -> str:
        algorithm = self._algorithm
        rate = (algorithm.env_steps - self._start_steps) / elapsed
        parts = [
            f"update {algorithm.updates:,}",
            f"{algorithm.env_steps:,} steps",
            f"{tqdm.format_sizeof(rate)} steps/s",
            algorithm.headline,
        ]
        fraction = self._limits.fraction(algorithm)
        if fraction > self._start_fraction:
            left = elapsed * (1.0 - fraction) / (fraction - self._start_fraction)
            parts.append(f"at most {tqdm.format_interval(left)} left")
        return ", ".join(parts)
