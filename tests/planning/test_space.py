"""The compiled free space agrees with shapely, whatever the segments."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString

from robocorba.maps.model import BoxShape, Building, Door, ElementKind, MapObject, Wall
from robocorba.planning.segments import segments_distance2
from robocorba.planning.space import FloorSpace, line_clearance, line_free
from robocorba.spatial.grids import build_grid
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
        assert space.point_is_free(x, y, 0.4) == expected, (x, y, distance)


def _edited(building: Building, rng: np.random.Generator, number: int) -> Building:
    """The building after one random edit of a wall, an object or a door of L1."""
    plan = building.floors["L1"].geometrical
    x, y = (float(value) for value in rng.uniform((1, 1), (11, 8)))
    what = int(rng.integers(6))
    if what == 0 and plan.walls:
        return building.without(ElementKind.WALL, "L1", list(plan.walls)[int(rng.integers(len(plan.walls)))])
    if what == 1 and plan.objects:
        return building.without(ElementKind.OBJECT, "L1", list(plan.objects)[int(rng.integers(len(plan.objects)))])
    if what == 2 and plan.objects:
        thing = list(plan.objects.values())[int(rng.integers(len(plan.objects)))]
        return building.with_element("L1", msgspec.structs.replace(thing, at=(x, y)))
    if what == 3 and plan.walls:
        wall = list(plan.walls.values())[int(rng.integers(len(plan.walls)))]
        door = Door(name=f"door{int(rng.integers(3))}", a=wall.a, b=wall.b, locked=bool(rng.integers(2)))
        return building.with_element("L1", door)
    if what == 4:
        box = MapObject(name=f"new{number}", shape=BoxShape((1.0, 0.5)), at=(x, y), heading=float(rng.uniform(0, 3)))
        return building.with_element("L1", box)
    return building.with_element("L1", Wall(name=f"wall{number}", a=(x, y), b=(x + 0.7, y - 0.4)))


@pytest.mark.parametrize("seed", range(8))
def test_an_edited_floor_is_as_if_made_anew(seed: int) -> None:
    rng = np.random.default_rng(seed)
    building = random_room(seed)
    space = FloorSpace(building, "L1")
    for number in range(25):
        building = _edited(building, rng, number)
        space, rebuilt = FloorSpace(building, "L1", space), FloorSpace(building, "L1")
        assert sorted(map(tuple, space.grid.segments.tolist())) == sorted(map(tuple, rebuilt.grid.segments.tolist()))
        assert sorted((item.kind, item.name) for item in space.owners) == sorted(
            (item.kind, item.name) for item in rebuilt.owners
        )
        for x, y in rng.uniform((-0.5, -0.5), (12.5, 9.5), (40, 2)):
            assert space.is_ground(x, y) == rebuilt.is_ground(x, y)
            near, same = space.nearest(x, y, 1.0), rebuilt.nearest(x, y, 1.0)
            assert near[0] == same[0]


def test_an_empty_floor_is_free_everywhere() -> None:
    grid = build_grid(np.empty((0, 4)))
    assert line_free(grid, -1e5, 0.0, 1e5, 0.0, 3.0)


def _line(points: tuple[float, ...]) -> shapely.Geometry:
    return LineString([points[:2], points[2:]]) if points[:2] != points[2:] else shapely.Point(points[:2])
