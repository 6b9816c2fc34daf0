"""The package as a whole: light to import."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_importing_and_searching_bring_neither_torch_nor_matplotlib() -> None:
    code = (
        "import sys, dpsearch.search as s, dpsearch.search.functions;"
        "[t([0.0, 0.0], 1.0, seed=0).ask() for t in (s.NES, s.XNES, s.SNES, s.FEM)];"
        "s.Restarts(s.XNES, [0.0], 1.0, seed=0).ask();"
        "print(*sys.modules)"
    )
    result = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True, text=True)
    assert not {"torch", "matplotlib", "gymnasium", "numba", "cma", "hydra"} & set(result.stdout.split())
