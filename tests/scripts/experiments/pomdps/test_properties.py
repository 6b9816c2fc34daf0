"""Table 7.1."""

from __future__ import annotations

from pathlib import Path

import pytest

from scripts.reproduce import main


def test_table_7_1_is_made_from_the_environments(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["table_7_1", "--out", str(tmp_path)])
    text = capsys.readouterr().out
    assert "| Shuttle docking | 8 | 3 | 5 | yes | yes |" in text
    assert "| 89-state maze | 89 | 5 | 16 (17) | yes | yes |" in text
