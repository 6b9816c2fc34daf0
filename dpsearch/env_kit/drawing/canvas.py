"""An anti-aliased canvas for pictures of tasks, and a window that shows frames."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from dpsearch.env_kit.drawing.palette import INK, PAPER

Point = tuple[float, float]
Frame = NDArray[np.uint8]

_OVERSAMPLING = 2  # shapes are drawn so much larger and then shrunk, which smooths their edges
_SMALLEST = 10  # size of text that can still be read


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

    def paste(self, corner: tuple[int, int], inner: Canvas) -> None:
        """Another canvas with its upper left corner at ``corner``; whatever is drawn beyond its frame is cut off."""
        self._image.paste(inner._image, (corner[0] * _OVERSAMPLING, corner[1] * _OVERSAMPLING))

    def path(self, points: Sequence[Point], color: str, width: float = 2, closed: bool = False) -> None:
        """A line through all the points, with rounded joints, back to the first one if it is closed."""
        scaled = [_scaled(point) for point in points]
        if closed:
            scaled += scaled[:2]
        if len(scaled) > 1:
            self._draw.line(scaled, color, round(width * _OVERSAMPLING), joint="curve")

    def box(
        self, corner: Point, opposite: Point, fill: str | None, outline: str | None = None, radius: float = 0
    ) -> None:
        """A rectangle with rounded corners, from its upper left to its lower right corner."""
        corners = [value * _OVERSAMPLING for value in (*corner, *opposite)]
        self._draw.rounded_rectangle(corners, radius * _OVERSAMPLING, fill, outline, 2 * _OVERSAMPLING)

    def disc(self, center: Point, radius: float, fill: str | None, outline: str | None = None) -> None:
        """A filled circle."""
        self._draw.circle(_scaled(center), radius * _OVERSAMPLING, fill, outline, 2 * _OVERSAMPLING)

    def polygon(self, corners: Sequence[Point], fill: str) -> None:
        """A filled polygon through its corners, in their order."""
        self._draw.polygon([_scaled(corner) for corner in corners], fill)

    def line(self, start: Point, end: Point, color: str, width: float = 2) -> None:
        """A straight line."""
        ends = [value * _OVERSAMPLING for value in (*start, *end)]
        self._draw.line(ends, color, round(width * _OVERSAMPLING))

    def dashes(self, start: Point, end: Point, color: str, width: float = 1.5, count: int = 10) -> None:
        """A straight line of ``count`` dashes, with gaps as long as these."""
        (x, y), (dx, dy) = start, (end[0] - start[0], end[1] - start[1])
        for k in range(count):
            a, b = 2 * k / (2 * count), (2 * k + 1) / (2 * count)
            self.line((x + a * dx, y + a * dy), (x + b * dx, y + b * dy), color, width)

    def arc(self, center: Point, radius: float, angles: tuple[float, float], color: str, width: float = 2) -> None:
        """Part of a circle, between two angles in degrees, clockwise from the right."""
        (x, y), r = _scaled(center), radius * _OVERSAMPLING
        self._draw.arc((x - r, y - r, x + r, y + r), *angles, color, round(width * _OVERSAMPLING))

    def arrow(self, center: Point, direction: Point, size: float, color: str) -> None:
        """An arrow of length ``size`` along one of the four directions, e.g. ``(0, -1)`` for up."""
        outline = [(0.5, 0), (0.06, 0.36), (0.06, 0.13), (-0.5, 0.13)]  # upper half of an arrow to the right
        outline += [(along, -across) for along, across in reversed(outline)]
        (x, y), (dx, dy) = center, direction
        self.polygon([(x + size * (a * dx - b * dy), y + size * (a * dy + b * dx)) for a, b in outline], color)

    def text(
        self, at: Point, text: str, size: int = 16, color: str = INK, anchor: str = "lm", width: float = math.inf
    ) -> None:
        """One line of text, made smaller if it would be wider than ``width``.

        ``anchor`` is Pillow's: "lm" puts the middle of the line's left edge at the point.
        """
        while size > _SMALLEST and self.text_width(text, size) > width:
            size -= 1
        self._draw.text(_scaled(at), text, color, _font(size * _OVERSAMPLING), anchor)

    def paragraph(self, at: Point, text: str, width: float, size: int = 16, color: str = INK) -> float:
        """Text broken into lines as wide as ``width`` at most, from the upper left corner on; returns its height."""
        lines = [""]
        for word in text.split():
            longer = f"{lines[-1]} {word}".lstrip()
            if lines[-1] and self.text_width(longer, size) > width:
                lines.append(word)
            else:
                lines[-1] = longer
        spacing = 1.4 * size
        for i, line in enumerate(lines):
            self.text((at[0], at[1] + (i + 0.5) * spacing), line, size, color)
        return len(lines) * spacing

    def text_width(self, text: str, size: int) -> float:
        """Width of a line of text (pixels)."""
        return float(self._draw.textlength(text, _font(size * _OVERSAMPLING))) / _OVERSAMPLING


def _scaled(point: Point) -> Point:
    return point[0] * _OVERSAMPLING, point[1] * _OVERSAMPLING


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
        """Shows a frame ``(height, width, 3)`` and waits until the next one is due."""
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
