"""Pages of results: Markdown for people, JSON for machines."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dpsearch.files import atomic_write


@dataclass(frozen=True, kw_only=True)
class Document:
    """A page, written as JSON for machines and Markdown for people.

    Attributes:
        name: Name of the page, and the stem of its files' names.
        title: Title of the page, one line.
        text: The page, in Markdown.
        content: The results for machines.
        command: Command line that computes the results again.
        versions: Versions of all that the results depend on.
        machine: The machine that computed the results.
        figure: Whether the page has a figure.
    """

    name: str
    title: str
    text: str
    content: Mapping[str, Any]
    command: str
    versions: Mapping[str, str]
    machine: str
    figure: bool = False

    def json(self) -> str:
        """The results for machines."""
        head = {"name": self.name, "command": self.command, "versions": self.versions, "machine": self.machine}
        return dump({**head, **self.content})

    def markdown(self) -> str:
        """The results for people."""
        versions = ", ".join(f"{name} {version}" for name, version in self.versions.items())
        parts = [
            f"# {self.title}",
            *([f"![{self.title}]({self.name}.png)"] if self.figure else []),
            self.text,
            f"```bash\n{self.command}\n```",
            f"{self.machine}; {versions}.",
        ]
        return "\n\n".join(parts) + "\n"

    def write(self, folder: Path) -> None:
        """Write ``name.json`` and ``name.md``, each whole or not at all."""
        for suffix, text in (("json", self.json()), ("md", self.markdown())):
            atomic_write(folder / f"{self.name}.{suffix}", text)


def dump(content: Mapping[str, Any]) -> str:
    """JSON with an item on each line, but lists of numbers on one."""
    text = json.dumps(content, indent=1, allow_nan=False)
    text = re.sub(r"\[[\s\d.,eE+-]*\]", lambda numbers: re.sub(r"\s+", " ", numbers[0]), text)
    return text.replace("[ ", "[").replace(" ]", "]") + "\n"
