"""What pictures of tasks are made of: an anti-aliased canvas, and a window to show frames in."""

from __future__ import annotations

import os
from functools import cache
from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Point = tuple[float, float]
Frame = NDArray[np.uint8]

PAPER, INK, FAINT, LINE = "#faf9f6", "#1f2933", "#7b8794", "#cbd2d9"
BLUE, GREEN, RED = "#2563eb", "#15803d", "#c62828"
ORANGE, SAND, WHITE, MINT, ROSE = "#f08a24", "#efe6d2", "#ffffff", "#d3efd9", "#f7d4d2"

_OVERSAMPLING = 2  # shapes are drawn so much larger and then shrunk, which smooths their edges


@cache
def _font(size: int) -> Any:
    return ImageFont.load_default(size)


class Canvas:
    """A picture of ``width`` x ``height`` pixels; y points down."""

    def __init__(self, width: int, height: int) -> None:
        self._image = Image.new("RGB", (width * _OVERSAMPLING, height * _OVERSAMPLING), PAPER)
        self._draw = ImageDraw.Draw(self._image)

    def frame(self) -> Frame:
        """The finished picture, ``(height, width, 3)``."""
        return np.array(self._image.reduce(_OVERSAMPLING))

    def box(self, corner: Point, opposite: Point, fill: str, outline: str | None = None, radius: float = 0) -> None:
        """A rectangle, its upper left and lower right corner given, with rounded corners."""
        corners = [value * _OVERSAMPLING for value in (*corner, *opposite)]
        self._draw.rounded_rectangle(corners, radius * _OVERSAMPLING, fill, outline, 2 * _OVERSAMPLING)

    def disc(self, center: Point, radius: float, fill: str, outline: str | None = None) -> None:
        """A filled circle."""
        scaled = (center[0] * _OVERSAMPLING, center[1] * _OVERSAMPLING)
        self._draw.circle(scaled, radius * _OVERSAMPLING, fill, outline, 2 * _OVERSAMPLING)

    def line(self, start: Point, end: Point, color: str, width: float = 2) -> None:
        """A straight line."""
        ends = [value * _OVERSAMPLING for value in (*start, *end)]
        self._draw.line(ends, color, round(width * _OVERSAMPLING))

    def arrow(self, center: Point, direction: Point, size: float, color: str) -> None:
        """An arrow of length ``size`` along one of the four directions, e.g. ``(0, -1)`` for up."""
        outline = [(0.5, 0), (0.06, 0.36), (0.06, 0.13), (-0.5, 0.13)]  # of one that points right, upper half
        outline += [(along, -across) for along, across in reversed(outline)]
        (x, y), (dx, dy) = center, direction
        self._draw.polygon(
            [
                (
                    (x + size * (a * dx - b * dy)) * _OVERSAMPLING,
                    (y + size * (a * dy + b * dx)) * _OVERSAMPLING,
                )
                for a, b in outline
            ],
            color,
        )

    def text(self, at: Point, text: str, size: int = 16, color: str = INK, anchor: str = "lm") -> None:
        """One line of text; ``anchor`` is Pillow's: "lm" puts the middle of its left edge at the point."""
        scaled = (at[0] * _OVERSAMPLING, at[1] * _OVERSAMPLING)
        self._draw.text(scaled, text, color, _font(size * _OVERSAMPLING), anchor)


class Window:
    """A window that shows frames at a steady rate, until its user closes it.

    Raises:
        gymnasium.error.DependencyNotInstalled: If pygame is missing.
    """

    def __init__(self, title: str, frames_per_second: float) -> None:
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            import pygame
        except ImportError as error:
            raise DependencyNotInstalled('a window needs pygame: pip install "dpsearch[render]"') from error
        self._pygame = pygame
        self._title = title
        self._frames_per_second = frames_per_second
        self._screen: Any = None
        self._closed = False

    def show(self, frame: Frame) -> None:
        """Shows a frame ``(height, width, 3)`` and waits until it is due to be followed by the next."""
        pygame = self._pygame
        if self._closed:
            return
        size = (frame.shape[1], frame.shape[0])
        if self._screen is None:
            pygame.display.init()
            self._screen = pygame.display.set_mode(size)
            pygame.display.set_caption(self._title)
            self._clock = pygame.time.Clock()
        self._screen.blit(pygame.image.frombuffer(frame.tobytes(), size, "RGB"), (0, 0))
        pygame.display.flip()
        self._clock.tick(self._frames_per_second)
        if pygame.event.get(pygame.QUIT):
            self.close()

    def close(self) -> None:
        """Closes the window for good."""
        if self._screen is not None:
            self._pygame.display.quit()
            self._screen = None
        self._closed = True
