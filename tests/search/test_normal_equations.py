"""The normal equations of a quadratic fit, against the regressors written out."""

from __future__ import annotations

import numpy as np
import pytest

from dpsearch.search.normal_equations import normal_equations


@pytest.mark.parametrize(("n", "d"), [(1, 1), (6, 1), (40, 5), (60, 6), (225, 15), (300, 22)])  # blocks of all widths
def test_normal_equations_are_those_of_the_regressors_written_out(n: int, d: int) -> None:
    rng = np.random.default_rng(n)
    points, targets = rng.standard_normal((n, d)), rng.standard_normal(n)
    columns = [np.ones(n)]
    for b in range(d):
        columns += [points[:, b]]
        columns += [points[:, a] * points[:, b] for a in range(b)]
        columns += [(points[:, b] ** 2 - 1.0) / np.sqrt(2.0)]
    regressors = np.stack(columns, axis=1)
    p = regressors.shape[1]
    gram, right = np.full((p, p), np.nan), np.full(p, np.nan)
    normal_equations(points, targets, gram, right)
    np.testing.assert_allclose(np.triu(gram), np.triu(regressors.T @ regressors), rtol=0, atol=1e-12 * n)
    np.testing.assert_allclose(right, regressors.T @ targets, rtol=0, atol=1e-12 * n)
