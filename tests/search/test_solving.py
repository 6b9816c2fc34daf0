"""Every search finds the bottom of a bowl, and those with a full covariance that of a narrow rotated valley."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

from dpsearch.search import CMAES, FEM, NES, SNES, XNES
from dpsearch.search.functions import FUNCTIONS, rotated_and_shifted
from tests.support.searches import Maker

THESIS_5D: dict[str, Any] = {"forget_factor": 0.1, "covariance_forget_factor": 0.1, "centre": "new", "window": 50}
SOLVERS: dict[str, tuple[Maker, int, int]] = {  # and the evaluations they may use on Sphere and Ellipsoid
    "nes": (NES, 2500, 3500),
    "nes without importance mixing": (partial(NES, importance_mixing=False), 12_000, 18_000),
    "nes, additive": (partial(NES, update="additive"), 4000, 6000),
    "nes, exact gradient": (partial(NES, gradient="exact"), 3000, 5000),
    "xnes": (XNES, 3500, 5000),
    "snes": (SNES, 2500, 0),
    "fem": (FEM, 4500, 6500),
    "fem, as in the thesis": (partial(FEM, **THESIS_5D), 7000, 11_000),
    "fem, in batches": (partial(FEM, online=False, forget_factor=0.5, population=60, top=30), 7000, 10_000),
    "cmaes": (CMAES, 1500, 3000),
}


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", SOLVERS)
def test_sphere_in_five_dimensions(name: str, seed: int) -> None:
    make, budget, _ = SOLVERS[name]
    function = rotated_and_shifted(FUNCTIONS["Sphere"], 5, seed)
    search = make(np.zeros(5), 1.0, seed=seed, target=-1e-10, max_evaluations=budget)
    result = search.maximize(lambda x: -float(function(x)))
    assert "target" in result.stop
    assert result.best.x is not None
    assert np.linalg.norm(result.best.x - function.shift) <= 1e-5
    assert result.invalid == 0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", sorted(set(SOLVERS) - {"snes"}))
def test_rotated_ellipsoid_in_five_dimensions(name: str, seed: int) -> None:
    make, _, budget = SOLVERS[name]
    function = rotated_and_shifted(FUNCTIONS["Ellipsoid"], 5, seed)
    search = make(np.zeros(5), 1.0, seed=seed, target=-1e-10, max_evaluations=budget)
    result = search.maximize(lambda x: -float(function(x)))
    assert "target" in result.stop
    assert result.best.x is not None
    assert np.linalg.norm(result.best.x - function.shift) <= 1e-5


def test_the_search_stays_well_conditioned_down_to_the_smallest_numbers() -> None:
    search = NES(np.ones(5), 1.0, seed=0, target=-1e-28, max_evaluations=20_000, tolx=0.0)
    result = search.maximize(lambda x: -float(FUNCTIONS["Ellipsoid"](x)))
    assert "target" in result.stop
    covariance = search.factor @ search.factor.T
    widths = np.sqrt(np.linalg.eigvalsh(covariance / np.abs(covariance).max()))
    assert 100 < widths[-1] / widths[0] < 10_000  # the ellipsoid's own axes are as 1 to 1000


def test_one_dimension_is_enough() -> None:
    for make in (NES, XNES, SNES, CMAES, partial(FEM, forget_factor=0.2, window=20, top=5)):
        search = make([3.0], 1.0, seed=0, target=-1e-10, max_evaluations=5000)
        assert "target" in search.maximize(lambda x: -float(x @ x)).stop
