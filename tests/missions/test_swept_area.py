"""Swept areas contain the body at all times, with few corners."""

from __future__ import annotations

import math

import numpy as np
import shapely
from hypothesis import given, settings
from hypothesis import strategies as some
from shapely import Polygon

from robocorba.map_editor.polygons import FloorArea
from robocorba.missions.carry_planning import CarryLeg, CarryPlan
from robocorba.missions.formation import BACK_OFF_M, formations
from robocorba.missions.obstacles import placed
from robocorba.missions.swept_area import swept_areas
from robocorba.simulation.reservations import MAX_CORNERS

TABLE = shapely.box(-0.6, -0.4, 0.6, 0.4)
POSES = some.lists(some.tuples(some.floats(-8, 8), some.floats(-8, 8), some.floats(-3, 3)), min_size=1, max_size=6)


FORMATION = formations(TABLE, 3)[0]


def areas_of(*legs: CarryLeg) -> tuple[FloorArea, ...]:
    return swept_areas(CarryPlan(FORMATION, legs, TABLE))


@settings(deadline=None, max_examples=60)
@given(POSES, some.integers(0, 60))
def test_the_body_stays_within_the_swept_area(poses: list[tuple[float, float, float]], share: int) -> None:
    ((floor, corners),) = areas_of(CarryLeg("L1", np.array(poses), ""))
    area = Polygon(corners)
    assert floor == "L1"
    assert area.is_valid
    assert len(corners) * 5 <= MAX_CORNERS
    at = share / 60 * (len(poses) - 1)
    before, after = poses[int(at)], poses[min(int(at) + 1, len(poses) - 1)]
    pose = tuple(a + (at - int(at)) * (b - a) for a, b in zip(before, after, strict=True))
    assert area.buffer(0.03).covers(placed(FORMATION.footprint(TABLE), (pose[0], pose[1], pose[2])))


def test_the_swept_area_holds_the_gathering_and_little_more() -> None:
    gathered = FORMATION.footprint(TABLE, BACK_OFF_M)
    path = np.array([[0.0, 0.0, 0.0], [6.0, 0.0, 0.0]])
    (area,) = (Polygon(corners) for _, corners in areas_of(CarryLeg("L1", path, "")))
    for end in path.tolist():
        assert area.covers(placed(gathered, (end[0], end[1], end[2])))
    passed = shapely.union_all([placed(gathered, (x, 0.0, 0.0)) for x in np.linspace(0, 6, 60)])
    assert area.area < 1.25 * passed.convex_hull.area
    assert area.distance(shapely.Point(3.0, 2.5)) > 0.5


def test_each_leg_has_an_area() -> None:
    legs = [
        CarryLeg("L1", np.array([[0.0, 0.0, 0.0], [2.0, 0.0, math.pi]]), "E1"),
        CarryLeg("L2", np.array([[2.0, 0.0, math.pi]]), "E2"),
        CarryLeg("L3", np.array([[2.0, 0.0, math.pi], [5.0, 1.0, math.pi]]), ""),
    ]
    assert [floor for floor, _ in areas_of(*legs)] == ["L1", "L2", "L3"]
