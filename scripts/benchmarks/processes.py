"""Measurements that take a process of their own: starting, memory, compiling."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter, sleep

from scripts.benchmarks.measurement import Measurement

ROOT = Path(__file__).resolve().parents[2]
POLL_SECONDS = 0.005
PATIENCE_SECONDS = 300.0

_IMPORT = """
import json, sys, time
wall, cpu = time.perf_counter(), time.process_time()
import {module}
wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
print(json.dumps({{"wall": wall, "cpu": cpu, "torch": "torch" in sys.modules}}))
"""


def startup(repeats: int) -> list[Measurement]:
    """Waiting times at the start, when all is compiled and the files are in the system's cache."""
    rows = []
    for module in ("dpsearch", "dpsearch.envs"):
        code = _IMPORT.format(module=module)
        runs = [_json([sys.executable, "-c", code]) for _ in range(repeats + 1)][1:]
        if any(run["torch"] for run in runs):
            raise RuntimeError(f"import {module} brings torch")
        for kind, unit in (("wall", "s"), ("cpu", "core-seconds")):
            limit = 0.5 if module == "dpsearch" and kind == "wall" else None
            values = [run[kind] for run in runs]
            rows.append(Measurement.of(values, benchmark="startup", what=f"import {module}", unit=unit, at_most=limit))
    waits = [_first_update_of_train() for _ in range(repeats + 1)][1:]
    rows.append(Measurement.of(waits, benchmark="startup", what="train.py to its first update", unit="s", at_most=5.0))
    return rows


def memory(repeats: int) -> list[Measurement]:
    """The most memory that long corridors take; the numbers hardly vary, so three runs are enough."""
    updates = [probe("long_update") for _ in range(min(repeats, 3))]
    walks = [probe("longest_corridor") for _ in range(min(repeats, 3))]
    cases: list[tuple[str, str, list[float], float | None]] = [
        ("RPG update, N = 1000, batch 20, random walk: peak", "MiB", [run["peak"] for run in updates], 1024.0),
        ("of which before the update", "MiB", [run["imported"] for run in updates], None),
        ("T-maze, N = 100,000: build", "s", [run["build"] for run in walks], None),
        ("T-maze, N = 100,000: one step", "µs", [1e6 * run["step"] for run in walks], None),
        ("T-maze, N = 100,000: peak", "MiB", [run["peak"] for run in walks], None),
    ]
    return [
        Measurement.of(values, benchmark="memory", what=what, unit=unit, at_most=limit)
        for what, unit, values, limit in cases
    ]


def compilation(repeats: int) -> list[Measurement]:
    """The first update on a machine that has compiled nothing yet, once, and then again."""
    with tempfile.TemporaryDirectory() as cache:
        cold = probe("first_update", NUMBA_CACHE_DIR=cache)["core_seconds"]
        warm = [probe("first_update", NUMBA_CACHE_DIR=cache)["core_seconds"] for _ in range(repeats)]
    return [
        Measurement.of(values, benchmark="compilation", what=f"start and first update, {state}", unit="core-seconds")
        for state, values in (("nothing compiled yet", [cold]), ("all compiled", warm))
    ]


def probe(name: str, **environment: str) -> dict[str, float]:
    """The numbers of a probe (``probes.py``), run in a process of its own with these environment variables."""
    return _json([sys.executable, str(Path(__file__).with_name("probes.py")), name], **environment)


def _json(command: list[str], **environment: str) -> dict[str, float]:
    done = subprocess.run(
        command, cwd=ROOT, env={**os.environ, **environment}, check=True, stdout=subprocess.PIPE, text=True
    )
    numbers: dict[str, float] = json.loads(done.stdout)
    return numbers


def _first_update_of_train() -> float:
    """Seconds from the start of ``train.py`` to the end of its first update."""
    with tempfile.TemporaryDirectory() as folder:
        run = Path(folder) / "run"
        command = [sys.executable, str(ROOT / "train.py"), "algo=rpg", "env=tmaze", f"run_dir={run}", "progress=false"]
        start = perf_counter()
        process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        try:
            lines: list[str] = []
            while not lines:
                sleep(POLL_SECONDS)
                if process.poll() is not None or perf_counter() - start > PATIENCE_SECONDS:
                    raise RuntimeError(f"train.py made no update: {process.communicate()[1]}")
                if (run / "metrics.jsonl").exists():
                    lines = (run / "metrics.jsonl").read_text().splitlines()
            seen = perf_counter() - start
        finally:
            process.terminate()
            process.wait()
    # The file is flushed now and then, after the last of these updates
    first, last = (float(json.loads(line)["time/wall"]) for line in (lines[0], lines[-1]))
    return seen - (last - first)
