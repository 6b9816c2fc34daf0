"""A TORCS process that is driven in lock-step.

No other program can reach the process: it inherits one of a pair of connected sockets, over which the two talk.
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
    """The state of car and road, as TORCS reports it. To the left is positive.

    Attributes:
        time: Time since the car was put on the road (s).
        speed: Velocity along the car's axis (m/s).
        slip: Velocity across the car's axis (m/s).
        yaw_rate: Turning rate (rad/s).
        x: First coordinate of the car in the plane (m).
        y: Second coordinate of the car in the plane (m).
        yaw: Heading of the car in the plane (rad).
        to_middle: Distance from the road's middle line (m).
        width: Width of the road (m).
        steering: Angle of the front wheels, as a fraction of the lock.
        along: Distance from the start line, along the middle line (m).
        angle: Angle of the car relative to the road (rad).
        bearing: Direction of the middle of the road at the look-ahead distance, relative to the car's heading (rad).
        curvature: Curvature of the middle line at the look-ahead distance (1/m).
        gear: Number of the gear; -1 is reverse, 0 neutral.
        rpm: Speed of the engine (1/min).
        throttle: Position of the throttle, in [0, 1].
        brake: Position of the brake pedal, in [0, 1].
        mu: Friction of the road's surface below the car.
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
    """TORCS with one car, which is put on the road and then driven step by step.

    Args:
        track: Name of the track.
        car: Name of the car.
        control_hz: Control steps a second. TORCS computes in steps of 2 ms, of which a control step has as many as it
            takes to be right on average: 17, 17, 16 at 30 Hz.
        lookahead: Base (m) and gain (s) of the look-ahead distance.
        rays: Whether to compute ``State.rays``, which takes time.
        patience: Time without an order after which TORCS gives up (s).

    Attributes:
        length: Length of the road's middle line (m).
        steer_lock: Largest angle of the front wheels (rad).
        mass: Mass of the car and its fuel (kg).
        wheelbase: Distance between the axles (m).
        pid: Number of the process.

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
        """Whether the process still runs."""
        return self._finalizer.alive and self._process.poll() is None

    def put(self, distance: float, speed: float) -> State:
        """Puts the car on the middle line, rolling along it, and forgets the drive before.

        Args:
            distance: Distance from the start line, along the middle line (m); met within half a metre or so.
            speed: Speed along the middle line (m/s), met about as well.
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
        """The error about a process that has ended."""
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
