"""Measures every speed and size that the project promises: ``python scripts/benchmark.py [NAME ...] [--out DIR]``.

Core-seconds are CPU time of one thread, so that what else the machine does matters little; plain seconds are what one
waits for.
"""

from __future__ import annotations

import json
import sys
from argparse import ArgumentParser, ArgumentTypeError
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))  # Python itself looks into scripts/ only

from dpsearch.files import versions
from dpsearch.report.provenance import command, machine
from dpsearch.report.tables import number
from scripts.arguments import at_least
from scripts.benchmarks import BENCHMARKS
from scripts.benchmarks.measurement import Measurement


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, print a table, and write it where asked to."""
    arguments = sys.argv[1:] if arguments is None else arguments
    args = _parser().parse_args(arguments)
    rows: list[Measurement] = []
    for name in args.names or BENCHMARKS:
        print(f"{name} ...", file=sys.stderr, flush=True)
        rows += BENCHMARKS[name](args.repeats)
    table = markdown(rows)
    print(table)
    if args.out is not None:
        write(args.out, rows, table, command("scripts/benchmark.py", arguments))


def markdown(rows: Sequence[Measurement]) -> str:
    """The rows as a table, aligned so that it also reads well on a terminal."""
    cells = [["benchmark", "what", "median", "quartiles", "unit", "repeats", "promised"]]
    for row in rows:
        limit = row.at_least if row.at_most is None else row.at_most
        direction = "at least" if row.at_most is None else "at most"
        promise = "" if limit is None else f"{direction} {limit:,.12g}: {'kept' if row.met else 'MISSED'}"
        quartiles = f"{number(row.low)} to {number(row.high)}"
        cells.append([row.benchmark, row.what, number(row.median), quartiles, row.unit, str(row.repeats), promise])
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    cells.insert(1, ["-" * width for width in widths])
    lines = (" | ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)) for line in cells)
    return "\n".join(f"| {line} |" for line in lines)


def write(folder: Path, rows: Sequence[Measurement], table: str, how: str) -> None:
    """Write ``benchmark.json`` and ``benchmark.md``."""
    folder.mkdir(parents=True, exist_ok=True)
    content = {
        "name": "benchmark",
        "command": how,
        "versions": versions(),
        "machine": machine(),
        "rows": [{**asdict(row), "met": row.met} for row in rows],
    }
    (folder / "benchmark.json").write_text(json.dumps(content, indent=1) + "\n")
    installed = ", ".join(f"{name} {version}" for name, version in versions().items())
    words = "Core-seconds are CPU time of one thread; plain seconds are what one waits for."
    parts = ["# Speed and size", words, table, f"```bash\n{how}\n```", f"{machine()}; {installed}."]
    (folder / "benchmark.md").write_text("\n\n".join(parts) + "\n")


def _parser() -> ArgumentParser:
    parser = ArgumentParser(prog="benchmark.py", description=__doc__)
    known = ", ".join(BENCHMARKS)
    parser.add_argument("names", nargs="*", type=_known, metavar="NAME", help=f"of {known}; default: all")
    parser.add_argument(
        "--repeats", type=at_least(1), default=10, metavar="K", help="repetitions; default: %(default)s"
    )
    parser.add_argument("--out", type=Path, help="folder for benchmark.json and benchmark.md; default: only print")
    return parser


def _known(name: str) -> str:
    if name not in BENCHMARKS:
        raise ArgumentTypeError(f"unknown benchmark {name!r}: choose from {', '.join(BENCHMARKS)}")
    return name


if __name__ == "__main__":
    main()
