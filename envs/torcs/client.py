"""A TORCS process that is driven in lock-step.

Nobody else can reach it: the two talk over a pair of connected sockets, one of which the process inherits.
Between two orders its time stands still.
"""

from __future__ import annotations

import os
import signal
import socket
import struct
import subprocess
import tempfile
import weakref
from typing import IO, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dpsearch.envs.torcs.installation import OWN_CAR, Installation, Race, Stage, TorcsError

RAYS: Final = 9

_LONGEST_SILENCE = 60.0  # s: TORCS starts in a tenth of a second, and answers much faster
_HOLD, _PRESS, _PUT, _ROAD = range(4)
_ORDER = struct.Struct("3d")
_HELLO = struct.Struct("4d")


class State(NamedTuple):
    """How things are. To the left is positive.

    Attributes:
        time: Since the car was put on the road (s).
        speed: Along the car's axis (m/s).
        slip: Across it (m/s).
        yaw_rate: rad/s.
        x: Place in the plane (m).
        y: Likewise.
        yaw: Heading in the plane (rad).
        to_middle: From the road's middle line (m).
        width: Of the road (m).
        steering: Where the front wheels point, as a fraction of the lock.
        along: From the start line, along the middle line (m).
        angle: Of the car relative to the road (rad).
        bearing: Relative to the car's heading, of the middle of the road at the look-ahead distance (rad).
        curvature: Of the middle line there (1/m).
        gear: -1 is reverse, 0 neutral.
        rpm: Of the engine (1/min).
        throttle: In [0, 1].
        brake: In [0, 1].
        mu: Friction of the road's surface here.
        rays: Free road (m) in nine directions from 60 degrees to the right to 60 to the left; 0 unless asked for.
    """

    time: float
    speed: float
    slip: float
    yaw_rate: float
    x: float
    y: float
    yaw: float
    to_middle: float
    width: float
    steering: float
    along: float
    angle: float
    bearing: float
    curvature: float
    gear: float
    rpm: float
    throttle: float
    brake: float
    mu: float
    rays: tuple[float, ...]


_SINGLE = len(State._fields) - 1
_STATE = struct.Struct(f"{_SINGLE + RAYS}d")


class Simulator:
    """TORCS with one car, which is put somewhere and then driven step by step.

    Args:
        track: Name of the track.
        car: Name of the car.
        control_hz: Steps a second. TORCS computes in steps of 2 ms, of which a control step has as many as it takes
            to be right on average: 17, 17, 16 at 30 Hz.
        lookahead: Base (m) and gain (s) of the look-ahead distance.
        rays: Whether ``State.rays`` is wanted, which takes time.
        patience: Seconds without an order after which TORCS gives up.

    Attributes:
        length: Of the road's middle line (m).
        steer_lock: The largest angle of the front wheels (rad).
        mass: Of the car and its fuel (kg).
        wheelbase: Distance of the axles (m).
        pid: Of the process.

    Raises:
        TorcsError: If TORCS is missing or does not start.
        ValueError: If there is no such track or car.
    """

    def __init__(
        self,
        track: str = "e-track-1",
        car: str = OWN_CAR,
        *,
        control_hz: float = 30.0,
        lookahead: tuple[float, float] = (10.0, 1.0),
        rays: bool = False,
        patience: float = 3600.0,
    ) -> None:
        stage = Stage(Installation.find(), Race(track, car))
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        try:
            with theirs:
                options = [theirs.fileno(), patience, control_hz, *lookahead, int(rays)]
                stage.environment["DPSEARCH_LOCKSTEP"] = " ".join(map(str, options))
                self._log = tempfile.TemporaryFile()  # noqa: SIM115  # for as long as the process
                self._process = subprocess.Popen(
                    stage.command,
                    cwd=stage.root / "data",
                    env=stage.environment,
                    pass_fds=(theirs.fileno(),),
                    stdin=subprocess.DEVNULL,
                    stdout=self._log,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,  # Ctrl-C is for us to handle
                )
            self.pid = self._process.pid
            self._socket = ours
            self._finalizer = weakref.finalize(self, _finish, os.getpid(), self._process, ours, self._log)
            ours.settimeout(_LONGEST_SILENCE)
            hello = _HELLO.unpack(self._receive(_HELLO.size))
        finally:
            stage.remove()  # once it runs, TORCS needs no files: so none remain, whatever comes to an end first
        self.length, self.steer_lock, self.mass, self.wheelbase = hello

    @property
    def running(self) -> bool:
        """Whether the process is there."""
        return self._finalizer.alive and self._process.poll() is None

    def put(self, distance: float, speed: float) -> State:
        """Puts the car on the middle line, rolling along it; all that was before is forgotten.

        Args:
            distance: From the start line, along the middle line (m); within half a metre or so.
            speed: m/s, likewise.
        """
        return self._state(_PUT, distance, speed)

    def hold(self, steering: float, speed: float) -> State:
        """One control step, in which throttle, brake and gears are used to hold a speed (m/s)."""
        return self._state(_HOLD, steering, speed)

    def press(self, steering: float, pedal: float) -> State:
        """One control step with a pedal: throttle above 0, brake below."""
        return self._state(_PRESS, steering, pedal)

    def road(self) -> NDArray[np.float64]:
        """The middle line from the start line on, at equal distances: x, y and the road's width (m), ``(K, 3)``."""
        self._send(_ROAD, 0.0, 0.0)
        return np.frombuffer(self._receive(), np.float64).reshape(-1, 3)

    def close(self) -> None:
        """Ends the process."""
        self._finalizer()

    def _state(self, *order: float) -> State:
        self._send(*order)
        values = _STATE.unpack(self._receive(_STATE.size))
        return State._make((*values[:_SINGLE], values[_SINGLE:]))

    def _send(self, *order: float) -> None:
        try:
            self._socket.send(_ORDER.pack(*order))
        except OSError as error:
            raise self._ended() from error

    def _receive(self, size: int | None = None) -> bytes:
        try:
            record = self._socket.recv(1 << 20 if size is None else size + 1)
        except TimeoutError:
            self.close()
            raise TorcsError(f"TORCS did not answer for {_LONGEST_SILENCE:.0f} s and was ended") from None
        except OSError as error:
            raise self._ended() from error
        if not record or size not in (None, len(record)):
            raise self._ended()
        return record

    def _ended(self) -> TorcsError:
        """What to say of a process that is not there any more."""
        if not self._finalizer.alive:
            return TorcsError("this TORCS has been closed")
        try:
            code = self._process.wait(5.0)
            how = f"was killed by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
        except subprocess.TimeoutExpired:
            how = "answered nonsense"
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").splitlines()
        said = f"; its last words: {lines[-1].strip()}" if lines and not how.startswith("was killed") else ""
        self.close()
        return TorcsError(f"TORCS {how}{said}")


def _finish(owner: int, process: subprocess.Popen[bytes], link: socket.socket, log: IO[bytes]) -> None:
    """Ends a process, unless this is a fork of the process that it belongs to."""
    link.close()
    log.close()
    if os.getpid() == owner:
        process.kill()
        process.wait()
