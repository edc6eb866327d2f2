"""Perception, in a room with things, some of which a map explains. Rays are a model of its own."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
import shapely
from shapely import LinearRing, LineString, Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from robocorba.errors.services import NotReachable
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.frames import Frame
from robocorba.robot.perception import Perception, SeenThing
from robocorba.robot.scans import Scan

RANGE_M, STEP_S, RADIUS_M = 8.0, 0.2, 0.40
ANGLES = np.arange(-180, 180) * math.pi / 180
ROOM = LinearRing([(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)])
AT: Frame = (5.0, 5.0, 0.0)


def scan_of(things: Sequence[BaseGeometry], at: Frame = AT, noise: Floats | float = 0.0) -> Scan:
    """Where rays around a robot meet the borders of things, or of the room, on the floor."""
    ends, is_hit = [], []
    borders = shapely.union_all([ROOM, *(thing.boundary for thing in things)])
    for angle, error in zip(ANGLES, np.broadcast_to(noise, ANGLES.shape), strict=True):
        along = np.array([math.cos(angle), math.sin(angle)])
        met = borders.intersection(LineString([at[:2], at[:2] + RANGE_M * along]))
        length = RANGE_M if met.is_empty else met.distance(Point(at[:2])) + float(error)
        ends.append(at[:2] + length * along)
        is_hit.append(not met.is_empty)
    return Scan(0.0, at, at[:2], np.array(ends), np.array(is_hit), np.full(len(ANGLES), 0.01))


class Robot:
    """known: what its map and others explain, beside the room."""

    def __init__(self, known: Sequence[BaseGeometry] = ()) -> None:
        self.known, self.is_informed = list(known), True
        self.perception = Perception(lambda: None, lambda: "L1", self._explains)
        self.now = 1000.0

    def _explains(self, floor: str, points: Floats, within_m: Floats) -> Floats:
        if not self.is_informed:
            raise NotReachable("no pool")
        return shapely.distance(shapely.points(points), shapely.union_all([ROOM, *self.known])) <= within_m

    def look(self, scan: Scan | None, times: int = 1) -> Sequence[SeenThing]:
        for _ in range(times):
            self.now += STEP_S
            self.perception.update("L1", [scan] if scan else [], self.now)
        return self.perception.things


def test_a_thing_has_number_outline_and_age_and_goes_when_rays_pass() -> None:
    robot, chair = Robot(), box(6.5, 4.8, 7.0, 5.2)
    (thing,) = robot.look(scan_of([chair]), 10)
    assert (thing.number, thing.floor, thing.first_seen) == (1, "L1", pytest.approx(1000.2))
    assert thing.last_seen == pytest.approx(robot.now)
    assert 0.9 < thing.certainty < 1.0
    assert thing.at == pytest.approx((6.5, 5.0), abs=0.03)  # the side that it sees
    assert Polygon(thing.outline).hausdorff_distance(LineString([(6.5, 4.8), (6.5, 5.2)])) < 0.06
    for at in ((6.5, 2.5, 0.0), (8.5, 3.5, 0.0), (8.5, 5.0, 0.0)):
        (same,) = robot.look(scan_of([chair], at), 5)
    assert (same.number, same.first_seen) == (1, thing.first_seen)
    assert same.at == pytest.approx((6.75, 5.0), abs=0.03)
    assert robot.perception.obstacles.names == ("seen thing 1",)
    assert not robot.look(scan_of([]), 6)
    assert robot.perception.obstacles.forbidden_areas == ()
    (other,) = robot.look(scan_of([chair]), 2)
    assert other.number == 2
