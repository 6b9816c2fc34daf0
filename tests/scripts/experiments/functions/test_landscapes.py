import json
from pathlib import Path

import pytest

from scripts import reproduce


def test_table_4_1_has_all_functions(tmp_path: Path) -> None:
    reproduce.main(["table_4_1", "--out", str(tmp_path)])
    content = json.loads((tmp_path / "table_4_1.json").read_text())
    rows = {row["name"]: row for row in content["rows"]}
    assert len(rows) == 12
    assert rows["Ellipsoid"]["costs"]["e_d"] == pytest.approx(1e6)
    assert (rows["SharpR"]["least"], rows["SharpR"]["target"]) == (None, -1000.0)
    assert rows["Sphere"]["cost"] == "sum z_j^2"
    lines = (tmp_path / "table_4_1.md").read_text().splitlines()
    assert {line.replace(r"\|", "").count("|") for line in lines if line.startswith("|")} == {10}
    assert not (tmp_path / "table_4_1.png").exists()


def test_figure_4_4_shows_a_search_that_reaches_the_optimum(tmp_path: Path) -> None:
    reproduce.main(["fig_4_4", "--out", str(tmp_path)])
    found = json.loads((tmp_path / "fig_4_4.json").read_text())
    first, last = found["ellipses"][0], found["ellipses"][-1]
    assert first["covariance"] == [[1.0, 0.0], [0.0, 1.0]]
    assert found["best"] <= 0.01
    assert max(abs(value) for value in last["mean"]) < 0.5
    assert f"reached a cost of 0.01 after {last['generation']} generations" in (tmp_path / "fig_4_4.md").read_text()
    assert (tmp_path / "fig_4_4.png").exists()
