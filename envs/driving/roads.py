"""Middle lines of closed roads: random ones by seed, named ones, and those given as a list of segments.

A random road is a polygon around a centre, which can't cross itself, with its corners rounded by arcs of random radii,
and smoothed along the road as roads are, so that the steering wheel need not be jerked. A road that comes too near to
itself, or has too tight a curve, is thrown away. So there are straights, fast bends and hairpins, to the left and to
the right.

A list of segments describes a road: ``["straight", 200]`` for 200 m, ``["turn", 50, -90]`` for a quarter
of a circle of radius 50 m to the right. Straights are made a little longer or shorter where that closes the road.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

Array = NDArray[np.float64]

STRAIGHT, TURN = "straight", "turn"
NAMED: Final[Mapping[str, Sequence[Sequence[Any]]]] = {
    "oval": [[STRAIGHT, 500], [TURN, 120, 180], [STRAIGHT, 500], [TURN, 120, 180]],
    "circuit": [
        *([STRAIGHT, 555], [TURN, 60, 90], [STRAIGHT, 177], [TURN, 90, 75], [STRAIGHT, 66], [TURN, 70, -75]),
        *([STRAIGHT, 217], [TURN, 30, 180], [STRAIGHT, 223], [TURN, 80, -95], [STRAIGHT, 168], [TURN, 150, 95]),
        *([STRAIGHT, 143], [TURN, 45, 90]),
    ],
    "g-track-2": [
        *([STRAIGHT, 185], [TURN, 200, -30], [STRAIGHT, 150], [TURN, 90, -30], [STRAIGHT, 150], [TURN, 100, 60]),
        *([TURN, 60, 60], [STRAIGHT, 100], [TURN, 50, 60], [STRAIGHT, 500], [TURN, 50, -60], [TURN, 50, 40]),
        *([TURN, 90, 80], [TURN, 150, 20], [TURN, 150, -20], [STRAIGHT, 450], [TURN, 150, 50], [TURN, 100, 30]),
        *([TURN, 100, -30], [STRAIGHT, 150], [TURN, 100, 130], [STRAIGHT, 348]),
    ],
}
"""Roads that have a name, as segments; the last has the middle line of TORCS' g-track-2, which is 15 m wide."""

_LENGTHS: Final = (2000.0, 4000.0)  # m, lengths of random roads
_TIGHTEST: Final = 25.0  # m, radius of hairpins of random roads
_APART: Final = 45.0  # m, how near random roads may come to themselves
_SMOOTHING: Final = 6.0  # m, standard deviation of what smooths them
_STRETCH: Final = 0.25  # share by which a straight may change for a road to close


@dataclass(frozen=True)
class Shape:
    """A closed middle line, sampled at even distances of about a metre, in the direction of travel.

    Attributes:
        x: Place east of the start line (m), ``(K,)``.
        y: Place north of the start line (m), ``(K,)``.
        heading: Direction of travel, anticlockwise from east (rad), without jumps, ``(K,)``.
        curvature: Curvature (1/m), positive where the road bends to the left, ``(K,)``.
        length: Length of a lap (m).
    """

    x: Array
    y: Array
    heading: Array
    curvature: Array
    length: float

    @property
    def spacing(self) -> float:
        """Distance between two samples (m)."""
        return self.length / len(self.x)

    @property
    def turning(self) -> float:
        """Turn of the heading in a lap (rad): one full turn, to the left or to the right."""
        return math.copysign(2.0 * math.pi, self.curvature.sum())

    @property
    def tightest(self) -> float:
        """The smallest radius (m)."""
        return float(1.0 / max(np.abs(self.curvature).max(), 1e-9))

    def at(self, distance: float, offset: float = 0.0) -> tuple[float, float, float]:
        """Place on the ground (m) and heading of the road (rad), at a distance along the road and to the left of it."""
        where = (distance % self.length) / self.spacing
        i = int(where) % len(self.x)
        share, j = where - int(where), (i + 1) % len(self.x)
        turned = math.remainder(self.heading[j] - self.heading[i], 2.0 * math.pi)
        heading = float(self.heading[i]) + share * turned
        x = self.x[i] + share * (self.x[j] - self.x[i]) - offset * math.sin(heading)
        y = self.y[i] + share * (self.y[j] - self.y[i]) + offset * math.cos(heading)
        return float(x), float(y), heading

    def comes_near(self, distance: float) -> bool:
        """Whether the road comes nearer to itself than this (m), other than by following its own course."""
        points = np.column_stack([self.x, self.y])
        pairs = cKDTree(points).query_pairs(distance, output_type="ndarray")
        apart = np.abs(pairs[:, 0] - pairs[:, 1])
        along = np.minimum(apart, len(self.x) - apart) * self.spacing
        return bool((along > 0.5 * math.pi * distance + 2.0 * self.spacing).any())


def make_shape(track: Any) -> Shape:
    """The middle line that the option ``track`` of the environment asks for.

    Args:
        track: A seed for a random road, a name of ``NAMED``, or a list of segments.

    Raises:
        ValueError: If ``track`` is none of these, or the segments don't close.
    """
    if isinstance(track, int | np.integer) and not isinstance(track, bool) and track >= 0:
        return random_shape(int(track))
    if isinstance(track, str) and track in NAMED:
        return shape_of(NAMED[track])
    if isinstance(track, Sequence) and not isinstance(track, str) and len(track) > 0:
        return shape_of(track)
    raise ValueError(
        f"track must be a seed of at least 0, one of {', '.join(NAMED)}, or a list of segments such as "
        f'["straight", 200] and ["turn", 50, -90], got {track!r}'
    )


def shape_of(segments: Sequence[Any]) -> Shape:
    """A road from its segments.

    Args:
        segments: Segments, each ["straight", metres] or ["turn", radius in metres, degrees to the left].

    Raises:
        ValueError: If a segment is neither straight nor turn, or the road doesn't close.
    """
    bends, lengths = np.array([_segment(segment) for segment in segments]).T
    turned = math.degrees(float(bends @ lengths))
    if abs(abs(turned) - 360.0) > 1e-6:
        raise ValueError(f"the turns of a closed track must add up to 360 or -360 degrees, not to {turned:g}")
    lengths = _closed(bends, lengths)
    ends = np.concatenate([[0.0], np.cumsum(lengths)])
    headings = np.concatenate([[0.0], np.cumsum(bends * lengths)])
    corners = np.concatenate([[[0.0, 0.0]], np.cumsum(_chords(bends, lengths, headings[:-1]), axis=0)])
    samples = max(round(ends[-1]), 16)
    along = np.arange(samples) * (ends[-1] / samples)
    which = np.searchsorted(ends, along, side="right") - 1
    into = along - ends[which]
    places = corners[which] + _chords(bends[which], into, headings[which])
    heading = headings[which] + bends[which] * into
    return Shape(places[:, 0], places[:, 1], heading, bends[which], float(ends[-1]))


def _segment(segment: Any) -> tuple[float, float]:
    """Curvature (1/m) and length (m) of a segment."""
    if isinstance(segment, Sequence) and not isinstance(segment, str) and len(segment) > 0:
        kind, *numbers = segment
        good = all(isinstance(n, int | float) and not isinstance(n, bool) and math.isfinite(n) for n in numbers)
        if good and kind == STRAIGHT and len(numbers) == 1 and numbers[0] > 0:
            return 0.0, float(numbers[0])
        if good and kind == TURN and len(numbers) == 2 and numbers[0] > 0 and 0 < abs(numbers[1]) <= 360:
            radius, angle = numbers
            return math.copysign(1.0 / radius, angle), radius * math.radians(abs(angle))
    raise ValueError(
        'a segment must be ["straight", metres] or ["turn", radius in metres, degrees to the left, negative to the '
        f"right], got {segment!r}"
    )


def _chords(bends: Array, lengths: Array, headings: Array) -> Array:
    """Vectors from the beginning to the end of arcs and straights, given their first headings, ``(n, 2)``."""
    half = 0.5 * bends * lengths
    chord = lengths * np.sinc(half / math.pi)
    return np.column_stack([chord * np.cos(headings + half), chord * np.sin(headings + half)])


def _closed(bends: Array, lengths: Array) -> Array:
    """The lengths of segments, with straights changed as little as is needed to close the road."""
    headings = np.concatenate([[0.0], np.cumsum(bends * lengths)[:-1]])
    gap = _chords(bends, lengths, headings).sum(axis=0)
    straight = bends == 0.0
    directions = np.stack([np.cos(headings), np.sin(headings)])[:, straight]
    change = np.linalg.lstsq(directions, -gap, rcond=1e-9)[0] if straight.any() else np.zeros(0)
    left_over = np.linalg.norm(gap + directions @ change)
    if left_over > 1e-6 or (np.abs(change) > _STRETCH * lengths[straight]).any():
        raise ValueError(
            f"the track doesn't close: it ends {np.linalg.norm(gap):.1f} m from its start, which is more than making "
            f"straights up to {_STRETCH:.0%} longer or shorter can mend"
        )
    closed = lengths.copy()
    closed[straight] += change
    return closed


@lru_cache(maxsize=16)
def random_shape(seed: int) -> Shape:
    """A random road, the same for the same seed; the start line is in the middle of its longest straight."""
    rng = np.random.default_rng(seed)
    while True:
        corners = _polygon(rng)
        if rng.random() < 0.5:
            corners = corners[::-1]
        rounded = _rounded(corners, rng)
        if rounded is None:
            continue
        shape = _from_straight(_resampled(_smoothed(rounded)))
        within = _LENGTHS[0] <= shape.length <= _LENGTHS[1]
        if within and shape.tightest >= _TIGHTEST and not shape.comes_near(_APART):
            return shape


def _polygon(rng: np.random.Generator) -> Array:
    """Corners around a centre, anticlockwise (m), ``(n, 2)``."""
    n = int(rng.integers(8, 14))
    angles = 2.0 * math.pi * (np.arange(n) + rng.uniform(-0.35, 0.35, n)) / n
    radii = rng.uniform(0.35, 1.0, n) * rng.uniform(350.0, 650.0)
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])


def _rounded(corners: Array, rng: np.random.Generator) -> Array | None:
    """The polygon with an arc at each corner, as points about a metre apart; None if the arcs do not fit."""
    edges = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(edges, axis=1)
    along = edges / lengths[:, None]
    before = np.roll(along, 1, axis=0)
    turns = np.arctan2(_cross(before, along), (before * along).sum(axis=1))
    room = 0.48 * np.minimum(lengths, np.roll(lengths, 1))
    tangents = np.tan(np.abs(turns) / 2.0)
    radii = np.minimum(np.exp(rng.uniform(math.log(28.0), math.log(250.0), len(corners))), room / tangents)
    if radii.min() < 1.05 * _TIGHTEST:
        return None
    pieces = []
    for corner, into, turn, radius, tangent, k in zip(
        corners, before, turns, radii, tangents, range(len(corners)), strict=True
    ):
        arc = np.linspace(0.0, turn, max(2, round(radius * abs(turn))), endpoint=False)
        side = math.copysign(1.0, turn)
        across = side * np.array([-into[1], into[0]])
        begin = corner - radius * tangent * into
        swept = np.abs(arc)[:, None]
        pieces.append(begin + radius * (np.sin(swept) * into + (1.0 - np.cos(swept)) * across))
        end = corner + radius * tangent * along[k]
        following = (k + 1) % len(corners)
        rest = corners[following] - radii[following] * tangents[following] * along[k] - end
        steps = max(1, round(float(np.linalg.norm(rest))))
        pieces.append(end + np.linspace(0.0, 1.0, steps, endpoint=False)[:, None] * rest)
    return np.concatenate(pieces)


def _cross(a: Array, b: Array) -> Array:
    product: Array = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return product


def _smoothed(points: Array) -> Array:
    """The closed line without sudden changes of its curvature: each point a weighted mean of those around it."""
    spacing = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1).mean()
    frequencies = 2.0 * math.pi * np.fft.rfftfreq(len(points), d=spacing)
    damping = np.exp(-0.5 * (_SMOOTHING * frequencies) ** 2)
    line: Array = np.fft.irfft(np.fft.rfft(points, axis=0) * damping[:, None], len(points), axis=0)
    return line


def _resampled(points: Array) -> Shape:
    """A smooth line through the points of a closed road, sampled evenly."""
    closed = np.concatenate([points, points[:1]])
    chords = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    spline = CubicSpline(chords, closed, bc_type="periodic")
    fine = np.linspace(0.0, chords[-1], 8 * len(points) + 1)
    pace = np.linalg.norm(spline(fine, 1), axis=1)
    lengths = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(fine))])
    samples = round(lengths[-1])
    at = np.interp(np.arange(samples) * (lengths[-1] / samples), lengths, fine)
    place, first, second = spline(at), spline(at, 1), spline(at, 2)
    heading = np.unwrap(np.arctan2(first[:, 1], first[:, 0]))
    curvature = _cross(first, second) / np.linalg.norm(first, axis=1) ** 3
    return Shape(place[:, 0], place[:, 1], heading, curvature, float(lengths[-1]))


def _from_straight(shape: Shape) -> Shape:
    """The road begun in the middle of its longest straight, which is turned to lead east from the origin."""
    bent = np.flatnonzero(np.abs(shape.curvature) > 1e-3)
    if len(bent) == 0:
        return shape
    gaps = np.diff(np.append(bent, bent[0] + len(shape.x)))
    longest = int(gaps.argmax())
    first = int(bent[longest] + gaps[longest] // 2) % len(shape.x)
    x, y, turn = shape.x[first], shape.y[first], shape.heading[first]
    cos, sin = math.cos(turn), math.sin(turn)
    east, north = np.roll(shape.x, -first) - x, np.roll(shape.y, -first) - y
    heading = np.unwrap(np.roll(shape.heading, -first)) - turn
    return Shape(
        cos * east + sin * north, cos * north - sin * east, heading, np.roll(shape.curvature, -first), shape.length
    )
