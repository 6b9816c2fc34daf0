"""Lap times of TORCS' own drivers, who know the track by heart, for comparison."""

from __future__ import annotations

import subprocess
import xml.etree.ElementTree as ET

from dpsearch.envs.torcs.installation import OWN_CAR, Installation, Race, Stage, TorcsError


def best_lap(track: str = "e-track-1", car: str = OWN_CAR, driver: str = "berniw", laps: int = 4) -> float:
    """The best lap time (s) of one of TORCS' own drivers, alone on the track, starting from rest.

    Laps in which it cuts corners or touches a wall don't count. Takes a fraction of a second.

    Args:
        track: Name of the track.
        car: Name of the car; drivers may set it up to their liking.
        driver: Name of the driver. On the default track, with the default car, "berniw" is the fastest of those who
            keep to the road.
        laps: Number of laps to drive, at least 1.

    Raises:
        ValueError: If there is no such track, car or driver, or the number of laps is out of range.
        TorcsError: If TORCS is missing, or the driver does not finish a lap that counts.
    """
    installation = Installation.find()
    drivers = installation.drivers()
    if driver not in drivers:
        raise ValueError(f"driver must be one of {', '.join(drivers)}, got {driver!r}")
    if laps < 1:
        raise ValueError(f"laps must be at least 1, got {laps}")
    stage = Stage(installation, Race(track, car, driver, laps=laps))
    try:
        subprocess.run(
            stage.command,
            cwd=stage.root / "data",
            env=stage.environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=60.0 + laps,
            check=False,
        )
        times = [time for path in stage.results() for time in _best_times(ET.parse(path))]
    except (subprocess.TimeoutExpired, ET.ParseError) as error:
        raise TorcsError(f"{driver} did not finish on {track} with {car}") from error
    finally:
        stage.remove()
    if not times:
        raise TorcsError(f"{driver} finished no lap that counts on {track} with {car}")
    return min(times)


def _best_times(results: ET.ElementTree[ET.Element]) -> list[float]:
    """The best lap times so far (s), lap by lap; TORCS writes 0 where there is none."""
    times = [float(entry.get("val", "0")) for entry in results.iterfind(".//attnum[@name='best lap time']")]
    return [time for time in times if time > 0.0]
