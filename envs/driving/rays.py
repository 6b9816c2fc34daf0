"""The free road in a direction, compiled: a car's distance sensor."""

from __future__ import annotations

import math
from typing import Final

from numba import njit

from dpsearch.envs.driving.rules import RAY_LENGTH
from dpsearch.kernels.lanes import FASTMATH

_STRIDE: Final = 2.0  # m, from one point of a ray to the next


@njit(fastmath=FASTMATH, error_model="numpy")
def free_road(floats, tables, rows, samples, spacing, half_width, distance, offset, direction):
    """Metres to the edge of the road, at most ``RAY_LENGTH``; 0 off the road.

    The ray is followed in strides. At each of its points the nearest sample of the middle line is found from the one
    before: the road between two samples is an arc so short that a parabola serves.

    Args:
        floats: Array with the tables of the middle line: x, y, heading, curvature, cosine and sine of the heading.
        tables: First index of the tables in ``floats``.
        rows: Numbers in each table.
        samples: Samples in a lap.
        spacing: Metres between samples.
        half_width: Half the width of the road (m).
        distance: Beginning of the ray along the middle line (m).
        offset: Beginning of the ray to the left of the middle line (m).
        direction: Direction of the ray, anticlockwise from east (rad).
    """
    if not abs(offset) <= half_width:
        return 0.0
    i = int(distance / spacing + 0.5) % samples
    along = distance - i * spacing
    if along > 0.5 * samples * spacing:
        along -= samples * spacing
    cos, sin = floats[tables + 4 * rows + i], floats[tables + 5 * rows + i]
    across = offset + 0.5 * floats[tables + 3 * rows + i] * along * along
    x = floats[tables + i] + along * cos - across * sin
    y = floats[tables + rows + i] + along * sin + across * cos
    step_x, step_y = _STRIDE * math.cos(direction), _STRIDE * math.sin(direction)
    before = offset
    for stride in range(1, int(RAY_LENGTH / _STRIDE) + 1):
        x += step_x
        y += step_y
        for _ in range(2):  # once more from the nearer sample
            cos, sin, bend = (
                floats[tables + 4 * rows + i],
                floats[tables + 5 * rows + i],
                floats[tables + 3 * rows + i],
            )
            east, north = x - floats[tables + i], y - floats[tables + rows + i]
            along, across = east * cos + north * sin, north * cos - east * sin
            i = (i + math.floor(along / max(1.0 - across * bend, 0.1) / spacing + 0.5)) % samples
        east, north = x - floats[tables + i], y - floats[tables + rows + i]
        cos, sin = floats[tables + 4 * rows + i], floats[tables + 5 * rows + i]
        along = east * cos + north * sin
        now = north * cos - east * sin - 0.5 * floats[tables + 3 * rows + i] * along * along
        if abs(now) > half_width:
            edge = half_width if now > 0.0 else -half_width
            return _STRIDE * (stride - 1 + (edge - before) / (now - before))
        before = now
    return RAY_LENGTH
