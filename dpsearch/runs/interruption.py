"""Ctrl-C, SIGTERM and SIGHUP: the update under way is finished first, and that is said at once."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Thread
from types import FrameType, TracebackType
from typing import Any

NUMBERS = [getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]


class Interrupted(BaseException):
    """A signal came where nothing needs to be finished."""


class Interruption:
    """While it is entered, a first signal is noted and answered; a second one ends the process at once.

    Python's own handlers wait until compiled code returns. So a thread of its own answers, and ends the process. A
    signal that is ignored, as ``nohup`` does with SIGHUP, stays so.

    Attributes:
        signal: The first signal that came, or None.
    """

    def __init__(self) -> None:
        self.signal: signal.Signals | None = None
        self._before: dict[signal.Signals, Any] = {}
        self._at_once = False

    def __enter__(self) -> Interruption:
        reader, self._writer = os.pipe()
        os.set_blocking(self._writer, False)
        self._wakeup = signal.set_wakeup_fd(self._writer, warn_on_full_buffer=False)
        self._watcher = Thread(target=self._watch, args=(reader,), daemon=True)
        self._watcher.start()
        for number in NUMBERS:
            if signal.getsignal(number) not in (signal.SIG_IGN, None):
                self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._wakeup)
        os.close(self._writer)
        self._watcher.join()

    @contextmanager
    def at_once(self) -> Iterator[None]:
        """While it is entered, a signal raises ``Interrupted``; as does one that came before.

        Raises:
            Interrupted: If a signal comes.
        """
        self._at_once = True
        try:
            self.check()
            yield
            self.check()
        finally:
            self._at_once = False

    def check(self) -> None:
        """Raise ``Interrupted`` if a signal came."""
        if self.signal is not None:
            raise Interrupted

    def _note(self, number: int, frame: FrameType | None) -> None:
        self.signal = signal.Signals(number)
        for each in self._before:
            signal.signal(each, signal.SIG_DFL)  # the system's own: ends compiled code too
        if self._at_once:
            raise Interrupted

    def _watch(self, reader: int) -> None:
        came = 0
        with open(reader, "rb", buffering=0) as numbers:
            while number := numbers.read(1):
                if number[0] in self._before:
                    came += 1
                    if came > 1:
                        os._exit(128 + number[0])  # compiled code kept ``_note`` waiting
                    after = "" if self._at_once else " after this update; once more stops at once"
                    with suppress(OSError):  # the terminal may be gone
                        os.write(2, f"{signal.Signals(number[0]).name}: stopping{after}\n".encode())
