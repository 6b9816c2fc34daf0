"""Parts that drawings of finite POMDPs share: the cards, a line of text, beliefs as percentages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dpsearch.env_kit.drawing import palette
from dpsearch.env_kit.drawing.canvas import Canvas, Point
from dpsearch.env_kit.drawing.scene import Card, Icon
from dpsearch.pomdp.env import Moment


def cards(moment: Moment, sees: Icon | None = None, did: Icon | None = None, digits: int = 2) -> list[Card]:
    """Cards with the observation, the last action, the step and the return.

    Args:
        moment: The moment to draw.
        sees: Pictogram of the observation.
        did: Pictogram of the last action.
        digits: Decimal places of rewards.
    """
    return [
        Card("The agent sees", seen(moment), icon=sees),
        Card("Its last action", moment.did, icon=did),
        Card("Step", f"{moment.step} of {moment.max_steps}"),
        Card("Return", earned(moment, digits)),
    ]


def seen(moment: Moment) -> str:
    """The observation in words, without a leading "sees"."""
    return moment.sees.removeprefix("sees ")


def earned(moment: Moment, digits: int = 2) -> str:
    """The return so far, unless it could give away what is hidden."""
    return f"{moment.episode_return:.{digits}f}" if moment.state_shown else "hidden"


def status(moment: Moment, digits: int = 2) -> str:
    """The cards as a line of text."""
    inputs = " ".join(f"{value:g}" for value in moment.inputs)
    did = "none" if moment.last_action is None else moment.did
    return (
        f"sees {seen(moment)} ({inputs}), last action {did}, "
        f"step {moment.step} of {moment.max_steps}, return {earned(moment, digits)}"
    )


def percent(probability: float) -> str:
    """A probability in percent, rounded; only what is certain is called 0% or 100%."""
    rounded = f"{100 * probability:.0f}%"
    if rounded == "0%" and probability > 0:
        return "<1%"
    return ">99%" if rounded == "100%" and probability < 1 - 1e-9 else rounded


def bar(
    canvas: Canvas, corner: Point, size: tuple[float, float], probability: float, color: str = palette.BLUE
) -> None:
    """A probability as a horizontal bar, its upper left corner given."""
    (x, y), (width, height) = corner, size
    canvas.box(corner, (x + width, y + height), palette.WHITE, palette.LINE, height / 2)
    if probability > 0:
        canvas.box(corner, (x + max(width * probability, height), y + height), palette.BLUE, radius=height / 2)


def likely(names: Sequence[str], belief: NDArray[np.float64], most: int = 8) -> str:
    """Names and probabilities of what is possible, the most probable first."""
    order = [i for i in np.argsort(-belief, kind="stable") if belief[i] > 0]
    shown = [f"{names[i]} {belief[i]:.1%}" for i in order[:most]]
    if len(order) > most:
        shown.append(f"others {belief[order[most:]].sum():.1%}")
    return "; ".join(shown)
