"""The frame around all drawings of tasks: title and aim, a message about the moment, and a row of cards below."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from dpsearch.env_kit.drawing import palette
from dpsearch.env_kit.drawing.canvas import Canvas, Point

WIDTH, HEIGHT = 960, 540
MARGIN = 40.0
_CARDS_TOP, _CARD_HEIGHT = 420.0, 88.0


class Icon(NamedTuple):
    """A pictogram: its width, and the function that draws it around a point."""

    width: float
    draw: Callable[[Canvas, Point], None]


class Message(NamedTuple):
    """A sentence about the present moment, and its color."""

    text: str
    color: str = palette.INK


@dataclass(frozen=True)
class Card:
    """A box that shows one quantity.

    Attributes:
        title: Name of the quantity.
        value: The quantity as text.
        note: A remark in a third line.
        icon: Pictogram at the right.
        fill: Color of the box.
        color: Color of the value.
    """

    title: str
    value: str
    note: str = ""
    icon: Icon | None = None
    fill: str = palette.WHITE
    color: str = palette.INK


def stage(title: str, aim: str, message: Message, cards: Sequence[Card]) -> Canvas:
    """A canvas with title, aim, message and cards; the task's own drawing goes between y = 110 and y = 410.

    Args:
        title: The task's name.
        aim: The aim in words, for people who have never heard of the task.
        message: A sentence about the present moment.
        cards: The row of cards at the bottom.
    """
    canvas = Canvas(WIDTH, HEIGHT)
    canvas.text((MARGIN, 42), title, 30)
    left = MARGIN + round(canvas.text_width(title, 30)) + 18
    canvas.text((left, 45), aim, 17, palette.FAINT, width=WIDTH - MARGIN - left)
    canvas.text((MARGIN, 88), message.text, 21, message.color, width=WIDTH - 2 * MARGIN)
    gap, inset = (16.0, 16.0) if len(cards) <= 4 else (10.0, 12.0)
    width = (WIDTH - 2 * MARGIN + gap) / len(cards) - gap
    for i, card in enumerate(cards):
        x = MARGIN + i * (width + gap)
        canvas.box((x, _CARDS_TOP), (x + width, _CARDS_TOP + _CARD_HEIGHT), card.fill, palette.LINE, 8)
        _fill_card(canvas, card, x + inset, width - 2 * inset)
    return canvas


def _fill_card(canvas: Canvas, card: Card, x: float, width: float) -> None:
    if card.note:
        canvas.text((x, _CARDS_TOP + 19), card.title, 13, palette.FAINT, width=width)
        canvas.text((x, _CARDS_TOP + 44), card.value, 18, card.color, width=width)
        canvas.text((x, _CARDS_TOP + 69), card.note, 14, palette.FAINT, width=width)
        return
    if card.icon is not None:
        card.icon.draw(canvas, (x + width - card.icon.width / 2, _CARDS_TOP + 58))
        width -= card.icon.width + 8
    canvas.text((x, _CARDS_TOP + 22), card.title, 14, palette.FAINT, width=width)
    canvas.text((x, _CARDS_TOP + 58), card.value, 20, card.color, width=width)


def arrow(direction: Point) -> Icon:
    """An action that has a direction, such as (0, -1) for up."""
    return Icon(34, lambda canvas, center: canvas.arrow(center, direction, 34, palette.INK))


def agent(canvas: Canvas, center: Point, radius: float, heading: Point | None = None) -> None:
    """The agent, in all tasks: a face, with a nose where it has a ``heading`` such as (0, -1) for up."""
    dx, dy = heading or (0.0, -1.0)

    def at(along: float, across: float) -> Point:
        return center[0] + radius * (along * dx - across * dy), center[1] + radius * (along * dy + across * dx)

    if heading is not None:
        canvas.polygon([at(1.4, 0), at(0.75, -0.62), at(0.75, 0.62)], palette.ORANGE)
    canvas.disc(center, radius, palette.ORANGE, palette.WHITE)
    for side in (-0.36, 0.36):
        canvas.disc(at(0.15 if heading is None else 0.4, side), radius * 0.16, palette.INK)
