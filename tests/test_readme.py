"""The README's promises, kept."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

README = Path(__file__).parents[1] / "README.md"


def test_the_library_example_runs_as_printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = README.read_text(encoding="utf-8").split("## As a library")[1]
    example = re.search(r"```python\n(.*?)```", text, re.DOTALL)
    assert example is not None
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    exec(compile(example[1], "README.md", "exec"), names)
    assert names["reward"] == 4.0  # it remembered the sign


def test_the_examples_of_searching_run_as_printed(capsys: pytest.CaptureFixture[str]) -> None:
    text = README.read_text(encoding="utf-8").split("## Search without gradients")[1].split("## ")[0]
    search, poles = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(search, "README.md", "exec"), names)
    assert "'target'" in capsys.readouterr().out
    exec(compile(poles, "README.md", "exec"), names)
    assert re.match(r"\d+ evaluations; \d+ of 625 other starts", capsys.readouterr().out)


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"])
def test_every_link_into_the_repository_leads_somewhere(page: str) -> None:
    links = re.findall(r"\]\(([^)#:]+)\)", (README.parent / page).read_text(encoding="utf-8"))
    assert [link for link in links if not (README.parent / link).exists()] == []


def test_nothing_was_left_to_be_filled_in() -> None:
    assert not re.search(r"@[A-Z]+@|TODO", README.read_text(encoding="utf-8"))
