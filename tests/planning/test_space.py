"""The compiled free space agrees with shapely, whatever the segments."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString

from robocorba.planning.space import (
    FloorSpace,
    against_one_way,
    build_grid,
    line_clearance,
    line_free,
    segments_distance2,
)
from tests.planning.scenes import random_room

coordinate = st.floats(-30, 30).map(lambda value: round(value, 3))
segment = st.tuples(coordinate, coordinate, coordinate, coordinate)


@settings(deadline=None, max_examples=200)
@given(st.lists(segment, min_size=1, max_size=30), segment, st.floats(0, 3))
def test_clearance_is_the_distance(segments: list[tuple[float, ...]], line: tuple[float, ...], reach: float) -> None:
    grid = build_grid(np.array(segments))
    expected = min(_line(line).distance(_line(each)) for each in segments)
    found, index = line_clearance(grid, *line, reach)
    assert found == pytest.approx(min(expected, reach), abs=1e-7)
    assert (index >= 0) == (expected < reach) or abs(expected - reach) < 1e-7
    if abs(expected - reach) > 1e-7 and expected > 1e-7:
        assert line_free(grid, *line, reach) == (expected >= reach)


@settings(deadline=None, max_examples=300)
@given(segment, segment)
def test_distance_of_two_segments(one: tuple[float, ...], other: tuple[float, ...]) -> None:
    assert math.sqrt(segments_distance2(*one, *other)) == pytest.approx(_line(one).distance(_line(other)), abs=1e-7)


@pytest.mark.parametrize("seed", range(5))
def test_where_a_robot_can_stand(seed: int) -> None:
    building = random_room(seed)
    space = FloorSpace(building, "L1")
    solid = shapely.union_all([item.geometry for item in space.owners])
    rng = np.random.default_rng(seed)
    for x, y in rng.uniform((-1, -1), (13, 10), (300, 2)):
        distance = solid.distance(shapely.Point(x, y))
        if abs(distance - 0.4) < 1e-6 or (distance < 1e-9 and not 0 < x < 12):
            continue
        expected = 0 < x < 12 and 0 < y < 9 and distance >= 0.4
        assert space.stands_free(x, y, 0.4) == expected, (x, y, distance)


def test_an_empty_floor_is_free_everywhere() -> None:
    grid = build_grid(np.empty((0, 4)))
    assert line_free(grid, -1e5, 0.0, 1e5, 0.0, 3.0)


@pytest.mark.parametrize(
    ("line", "refused"),
    [
        ((0.0, 0.0, 5.0, 0.0), False),  # along the edge
        ((5.0, 0.0, 0.0, 0.0), True),  # against it
        ((5.0, 0.3, 0.0, 0.3), True),  # against it, beside
        ((5.0, 1.0, 0.0, 1.0), False),  # against it, farther than the radius
        ((2.5, -2.0, 2.5, 2.0), False),  # across
        ((2.7, -2.0, 2.5, 2.0), False),  # across, a little backwards
        ((0.5, 0.0, 0.0, 0.0), False),  # shorter than the robot
    ],
)
def test_one_way(line: tuple[float, ...], refused: bool) -> None:
    lanes = np.array([[0.0, 0.0, 5.0, 0.0]])
    assert against_one_way(lanes, *line, 0.4) == refused


def _line(points: tuple[float, ...]) -> shapely.Geometry:
    return LineString([points[:2], points[2:]]) if points[:2] != points[2:] else shapely.Point(points[:2])
