"""Speed of reading files."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import process_time

from dpsearch.pomdp.file_format.reader import read_pomdp_file
from scripts.benchmarks.measurement import Measurement

STATES = 1250
LINES = 10_000  # besides the preamble: four of T, two of O and two of R for each state


def pomdp_file(repeats: int) -> list[Measurement]:
    """A .POMDP file of 10,000 lines, each with a single probability or reward, by name."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "corridor.POMDP"
        path.write_text("\n".join(corridor_lines()))
        times = []
        for _ in range(repeats + 1):
            start = process_time()
            read_pomdp_file(path)
            times.append(1e3 * (process_time() - start))
    what = f"reading a .POMDP file of {LINES:,} single entries, {STATES:,} states"
    return [Measurement.of(times[1:], benchmark="pomdp_file", what=what, unit="core-ms", at_most=500.0)]


def corridor_lines() -> Iterator[str]:
    """The lines of a .POMDP file: a corridor in which steps may fail."""
    names = [f"place-{number}" for number in range(STATES)]
    yield "discount: 0.95\nvalues: reward\nactions: left right\nobservations: dark light"
    yield f"states: {' '.join(names)}"
    for number, name in enumerate(names):
        for action, step in (("left", -1), ("right", 1)):
            yield f"T : {action} : {name} : {names[(number + step) % STATES]} 0.9"
            yield f"T : {action} : {name} : {name} 0.1"
            yield f"O : {action} : {name} : {'light' if number % 7 == 0 else 'dark'} 1.0"
            yield f"R : {action} : {name} : {names[(number + step) % STATES]} : * {number % 5}"
