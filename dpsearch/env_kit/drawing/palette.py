"""The colors that all drawings share."""

from __future__ import annotations

PAPER, WHITE, INK, FAINT, LINE = "#faf9f6", "#ffffff", "#1f2933", "#7b8794", "#cbd2d9"
BLUE, GREEN, RED = "#2563eb", "#15803d", "#c62828"
ORANGE, SAND, MINT, ROSE = "#f08a24", "#efe6d2", "#d3efd9", "#f7d4d2"
SKY, GOLD, NIGHT = "#8fb4f5", "#f2c230", "#141d33"


def mix(color: str, other: str, share: float) -> str:
    """A mixture of two colors: the first for a share of 0, the second for 1."""
    ends = zip(_channels(color), _channels(other), strict=True)
    return "#" + "".join(f"{round(a + (b - a) * share):02x}" for a, b in ends)


def _channels(color: str) -> bytes:
    return bytes.fromhex(color[1:])
