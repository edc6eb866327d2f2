"""Scans compared with shapely, which intersects each ray with all obstacles."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.errors.sensing import InvalidScan
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.simulation.sensing.fan import Fan
from robocorba.simulation.sensing.visible_obstacles import VisibleObstacles, border_segments

coordinate = st.floats(-20, 20).map(lambda value: round(value, 2))
point = st.tuples(coordinate, coordinate)
lines = st.lists(st.tuples(point, point).filter(lambda ends: ends[0] != ends[1]).map(LineString), max_size=12)
boxes = st.lists(
    st.tuples(point, st.floats(0.2, 3), st.floats(0.2, 3)).map(
        lambda box: shapely.box(*box[0], box[0][0] + box[1], box[0][1] + box[2])
    ),
    max_size=4,
)
discs = st.lists(st.tuples(coordinate, coordinate, st.floats(0.1, 3), st.integers(0, 5)), max_size=6)
poses = st.lists(st.tuples(coordinate, coordinate, st.floats(-7, 7)), min_size=1, max_size=3)
fans = st.builds(
    lambda first, turn, count, range_m: Fan(first, turn / count, count, range_m),
    st.floats(-math.pi, math.pi),
    st.floats(0.1, 2 * math.pi),
    st.integers(1, 40),
    st.floats(0.5, 60),
)


def reference(blocking: list[BaseGeometry], pose: tuple[float, float, float], fan: Fan) -> Floats:
    """Distance of each ray to the nearest obstacle, by shapely."""
    x, y, heading = pose
    everything = shapely.union_all([s.boundary if isinstance(s, Polygon) else s for s in blocking])
    found = np.full(fan.count, fan.range_m)
    for k, angle in enumerate(heading + fan.angles):
        end = (x + fan.range_m * math.cos(angle), y + fan.range_m * math.sin(angle))
        met = LineString([(x, y), end]).intersection(everything)
        if not met.is_empty:
            found[k] = Point(x, y).distance(met)
    return found


def agrees(
    found: float, blocking: list[BaseGeometry], pose: tuple[float, float, float], angle: float, fan: Fan
) -> bool:
    """Whether a distance is right for this ray or one beside it: a ray that touches a corner may or may not meet it.

    A ray along a line meets it where the line begins, which rounding hides from an exact intersection: then an obstacle
    must be at that distance, and none before it that both rays beside this one meet as well."""
    turns = (0.0, 1e-7, -1e-7)
    for turn in turns:
        (expected,) = reference(blocking, (*pose[:2], pose[2] + angle + turn), Fan(0.0, 1.0, 1, fan.range_m))
        if abs(found - expected) < 1e-5 * max(1.0, expected):
            return True
    everything = shapely.union_all([s.boundary if isinstance(s, Polygon) else s for s in blocking])

    def ray(turn: float, length: float) -> LineString:
        to = pose[2] + angle + turn
        return LineString([pose[:2], (pose[0] + length * math.cos(to), pose[1] + length * math.sin(to))])

    met = Point(ray(0.0, found).coords[1])
    return bool(
        everything.distance(met) < 1e-6
        and any(not ray(turn, found - 1e-5 * max(1.0, found)).intersects(everything) for turn in turns)
    )


@pytest.mark.parametrize("others", [[], [LineString([(0, -1), (-0.5, 0)])]])
def test_a_ray_along_a_line_meets_its_near_end(others: list[BaseGeometry]) -> None:
    blocking, fan = [LineString([(-1, 0), (-2, 0)]), *others], Fan(math.pi, 1.0, 1, 2.0)
    here = (0.0, 0.0, 0.0)
    found = VisibleObstacles(blocking).scan(np.array([here]), fan)[0]
    assert agrees(float(found[0]), blocking, here, math.pi, fan)
    wall, fan = [LineString([(1, -1), (1, 1)]), LineString([(2, -1), (2, 1)])], Fan(0.0, 1.0, 1, 5.0)
    assert agrees(1.0, wall, here, 0.0, fan)
    assert not any(agrees(distance, wall, here, 0.0, fan) for distance in (0.99, 1.01, 2.0, 5.0))


@settings(deadline=None, max_examples=50)
@given(lines, boxes, poses, fans)
def test_distances_to_segments_agree_with_shapely(
    standing: list[BaseGeometry], moved: list[BaseGeometry], places: list[tuple[float, float, float]], fan: Fan
) -> None:
    obstacles = VisibleObstacles(standing)
    obstacles.set_moving(np.empty((0, 4)), border_segments(moved))
    found = obstacles.scan(np.array(places), fan)
    assert found.shape == (len(places), fan.count)
    blocking = standing + moved
    for pose, distances in zip(places, found, strict=True):
        if blocking and shapely.union_all(blocking).distance(Point(pose[:2])) < 1e-6:
            continue  # a sensor on a line sees either side
        for angle, distance in zip(fan.angles, distances, strict=True):
            assert agrees(distance, blocking, pose, angle, fan), (pose, angle, distance)


@settings(deadline=None, max_examples=40)
@given(discs, poses, fans, st.integers(0, 5))
def test_robots_are_discs_and_do_not_see_themselves(
    robots: list[tuple[float, float, float, int]], places: list[tuple[float, float, float]], fan: Fan, me: int
) -> None:
    obstacles = VisibleObstacles([LineString([(-15, -15), (15, 14)])])
    obstacles.set_moving(np.array(robots).reshape(-1, 4))
    found = obstacles.scan(np.array(places), fan, [me] * len(places))
    others = [robot for robot in robots if robot[3] != me]
    for (x, y, heading), distances in zip(places, found, strict=True):
        alone = VisibleObstacles([LineString([(-15, -15), (15, 14)])]).scan(np.array([(x, y, heading)]), fan)[0]
        for angle, distance, expected in zip(fan.angles, distances, alone, strict=True):
            for cx, cy, radius, _ in others:
                dx, dy = cx - x, cy - y
                along = dx * math.cos(heading + angle) + dy * math.sin(heading + angle)
                inside = radius**2 - (dx**2 + dy**2 - along**2)
                if dx**2 + dy**2 <= radius**2:
                    expected = 0.0
                elif inside >= 0 and along > 0:
                    expected = min(expected, along - math.sqrt(inside))
            assert distance == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, math.pi, -math.pi / 2])
def test_a_fan_of_half_a_turn_sees_walls_beside_it(heading: float) -> None:
    side = 900.0
    obstacles = VisibleObstacles([shapely.box(-side, -side, side, side)])
    found = obstacles.scan(np.array([(0.0, 0.0, heading)]), Fan(-math.pi / 2, math.pi / 179, 180, 1000.0))[0]
    assert found[[0, -1]] == pytest.approx(side)
    assert found.max() == 1000.0


def test_bodies_can_move_far_beyond_the_walls_and_robots_are_replaced() -> None:
    obstacles = VisibleObstacles([shapely.box(0, 0, 10, 10)])
    obstacles.set_moving(np.array([(9.0, 5.0, 0.5, 1)]), border_segments([shapely.box(-400, 0, -399, 1)]))
    obstacles.set_moving(np.array([(500.0, 300.0, 0.5, 1)]))  # the segments stay
    found = obstacles.scan(np.array([(497.0, 300.0, 0.0), (-402.0, 0.5, 0.0), (5.0, 5.0, 0.0)]), Fan(0.0, 1.0, 1, 20.0))
    assert found[:, 0] == pytest.approx([2.5, 2.0, 5.0])


@pytest.mark.parametrize(
    ("field", "fan"),
    [
        ("rays", (0.0, 1.0, 0, 1.0)),
        ("rays", (0.0, 1e-9, 10**9, 1.0)),
        ("step", (0.0, 1.0, 8, 1.0)),
        *(("firstAngle", (angle, 1.0, 1, 1.0)) for angle in (math.nan, math.inf)),
        *(("step", (0.0, step, 1, 1.0)) for step in (0.0, -1.0, math.nan)),
        *(("range", (0.0, 1.0, 1, range_m)) for range_m in (0.0, -1.0, math.nan, math.inf)),
    ],
)
def test_an_invalid_fan_names_the_field(field: str, fan: tuple[float, float, int, float]) -> None:
    with pytest.raises(InvalidScan) as refused:
        Fan(*fan)
    assert refused.value.field == field
