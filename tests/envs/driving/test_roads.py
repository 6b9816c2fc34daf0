from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from dpsearch.envs.driving.roads import NAMED, Shape, make_shape

ROADS: list[Any] = [*range(12), *NAMED]


@pytest.fixture(params=ROADS)
def shape(request: pytest.FixtureRequest) -> Shape:
    return make_shape(request.param)


def test_a_road_is_closed_and_its_tables_agree_with_each_other(shape: Shape) -> None:
    places = np.column_stack([shape.x, shape.y])
    steps = np.roll(places, -1, axis=0) - places
    assert shape.spacing == pytest.approx(1.0, abs=1e-2)
    np.testing.assert_allclose(np.linalg.norm(steps, axis=1), shape.spacing, rtol=1e-3)
    heading = np.append(shape.heading, shape.heading[0] + shape.turning)
    between = 0.5 * (heading[1:] + heading[:-1])
    np.testing.assert_allclose(np.arctan2(*steps.T[::-1]), np.arctan2(np.sin(between), np.cos(between)), atol=6e-3)
    bends = np.append(shape.curvature, shape.curvature[0])
    largest = np.maximum(np.abs(bends[1:]), np.abs(bends[:-1]))
    turned = np.diff(heading) / shape.spacing
    assert (np.abs(turned) <= largest + 1e-3).all()
    assert abs(shape.turning) == pytest.approx(2 * math.pi)


def test_a_road_keeps_away_from_itself(shape: Shape) -> None:
    assert not shape.comes_near(40.0)


def test_it_is_noticed_where_a_road_comes_near_itself() -> None:
    bone = make_shape([*[["straight", 200], ["turn", 50, -60], ["turn", 50, 300], ["turn", 50, -60]] * 2])
    assert bone.comes_near(20.0)
    oval = make_shape([["straight", 300], ["turn", 15, 180], ["straight", 300], ["turn", 15, 180]])
    assert [oval.comes_near(distance) for distance in (20.0, 29.0, 31.0)] == [False, False, True]


@pytest.mark.parametrize("seed", range(12))
def test_a_random_road_has_straights_and_curves_of_sensible_size(seed: int) -> None:
    shape = make_shape(seed)
    assert 2000 <= shape.length <= 4000
    assert 25 <= shape.tightest <= 80
    assert 0.1 < np.mean(np.abs(shape.curvature) < 1e-3) < 0.8
    assert np.abs(np.diff(shape.curvature)).max() < 0.005  # nothing jerks the wheel
    assert (shape.x[0], shape.y[0], shape.heading[0]) == pytest.approx((0, 0, 0), abs=1e-9)
    assert np.abs(shape.curvature[-30:]).max() < 1e-3  # the start line is on a straight
    assert np.abs(shape.curvature[:30]).max() < 1e-3


def test_seeds_give_different_roads_and_the_same_seed_the_same() -> None:
    roads = [make_shape(seed) for seed in range(30)]
    assert len({road.length for road in roads}) == 30
    assert {road.turning > 0 for road in roads} == {True, False}
    np.testing.assert_array_equal(make_shape(3).x, roads[3].x)


def test_some_road_has_a_hairpin() -> None:
    assert min(make_shape(seed).tightest for seed in range(12)) < 30


def test_a_circle_is_a_circle() -> None:
    shape = make_shape([["turn", 50, 360]])
    assert shape.length == pytest.approx(100 * math.pi)
    np.testing.assert_allclose(np.hypot(shape.x, shape.y - 50), 50)
    np.testing.assert_allclose(shape.curvature, 0.02)
    assert shape.at(50 * math.pi / 2, 10.0) == pytest.approx((40, 50, math.pi / 2), abs=5e-3)
    assert shape.at(-50 * math.pi / 2)[:2] == pytest.approx((-50, 50), abs=5e-3)


def test_right_turns_are_negative() -> None:
    shape = make_shape([["straight", 100], ["turn", 30, -180], ["straight", 100], ["turn", 30, -180]])
    assert shape.turning == pytest.approx(-2 * math.pi)
    assert shape.y.min() == pytest.approx(-60, abs=1e-2)
    assert shape.length == pytest.approx(200 + 60 * math.pi)


def test_straights_are_stretched_a_little_to_close_a_road() -> None:
    shape = make_shape([["straight", 100], ["turn", 30, 180], ["straight", 90], ["turn", 30, 180]])
    assert shape.length == pytest.approx(190 + 60 * math.pi)
    assert shape.x.max() - shape.x.min() == pytest.approx(95 + 60, abs=0.1)


@pytest.mark.parametrize(
    ("track", "message"),
    [
        (-1, "track must be a seed of at least 0, one of oval, circuit, g-track-2, or a list of segments .* got -1"),
        (True, "track must be"),
        (1.5, "track must be"),
        ("monza", "one of oval, circuit.* got 'monza'"),
        ([], "track must be"),
        ([["straight", 100], ["turn", 50, 180]], "must add up to 360 or -360 degrees, not to 180"),
        ([["turn", 50, 180], ["turn", 60, 180]], r"doesn't close: it ends 20\.0 m from its start"),
        ([["straight", 100], ["turn", 50, 180], ["straight", 10], ["turn", 50, 180]], "doesn't close"),
        ([["straight", -5]], r"a segment must be \[\"straight\", metres\] or .* got \['straight', -5\]"),
        ([["turn", 50]], "a segment must be"),
        ([["turn", 50, 0]], "a segment must be"),
        ([["turn", 50, math.nan]], "a segment must be"),
        ([["bend", 50, 360]], "a segment must be"),
        (["straight"], "a segment must be"),
        ([[]], "a segment must be"),
        ([7], "a segment must be .* got 7"),
    ],
)
def test_impossible_tracks_are_refused(track: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_shape(track)
