"""The areas of the floors that an object and its carriers sweep, for the leader to reserve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.polygons import FloorArea
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.pose import XY, Pose2D
from robocorba.missions.carry_planning import CarryPlan
from robocorba.missions.obstacles import placed


def swept_areas(plan: CarryPlan) -> tuple[FloorArea, ...]:
    """An area (floor, corners [m]) around each of `swept_shapes`."""
    return tuple((floor, _corners(shape)) for floor, shape in swept_shapes(plan))


def swept_shapes(plan: CarryPlan) -> list[tuple[str, BaseGeometry]]:
    """The floor and a shape [m] for each leg: what object and carriers sweep, and at start and goal the room in which
    the carriers gather and back off."""
    gathered = plan.formation.footprint(plan.outline, plan.back_off_m)
    found = []
    for number, leg in enumerate(plan.legs):
        poses = [(x, y, heading) for x, y, heading in leg.poses.tolist()]
        shapes = swept(plan.footprint(), poses)
        if number == 0:
            shapes.append(placed(gathered, poses[0]).convex_hull)
        if number == len(plan.legs) - 1:
            shapes.append(placed(gathered, poses[-1]).convex_hull)
        found.append((leg.floor, shapely.union_all(shapes)))
    return found


def swept(body: BaseGeometry, poses: Sequence[Pose2D]) -> list[BaseGeometry]:
    """Convex hulls of the body between successive samples of its path."""
    hulls = [placed(body, pose).convex_hull for pose in _sampled(poses)]
    return [shapely.union_all(pair).convex_hull for pair in pairwise(hulls)] or hulls


def _sampled(poses: Sequence[Pose2D]) -> list[Pose2D]:
    """Poses along a path, at most 0.25 m and 0.2 rad apart."""
    found = [poses[0]]
    for here, there in pairwise(poses):
        parts = 1 + int(max(math.dist(here[:2], there[:2]) / 0.25, abs(there[2] - here[2]) / 0.2))
        for part in range(1, parts + 1):
            x, y, heading = (a + part / parts * (b - a) for a, b in zip(here, there, strict=True))
            found.append((x, y, heading))
    return found


def _corners(shape: BaseGeometry) -> tuple[XY, ...]:
    """The corners of a polygon around a connected shape, simplified until it has at most 100; of its hull if need
    be."""
    for tolerance_m in (0.05, 0.15, 0.5):
        around = _simplified(shapely.get_coordinates(shape.buffer(tolerance_m, quad_segs=2).exterior), tolerance_m)
        if around.is_valid and len(around.exterior.coords) <= 100:
            break
    else:
        around = shape.convex_hull
    return tuple((x, y) for x, y in shapely.get_coordinates(around.exterior)[:-1].tolist())


def _simplified(ring: Floats, tolerance_m: float) -> Polygon:
    """The polygon of a closed ring (n, 2) with fewer corners, all of the ring within the tolerance of it.

    In two halves, as GEOS moves the end of a ring by another tolerance."""
    far = int(np.hypot(*(ring - ring[0]).T).argmax())
    halves = (LineString(half).simplify(tolerance_m, preserve_topology=False) for half in (ring[: far + 1], ring[far:]))
    there, back = (shapely.get_coordinates(half) for half in halves)
    return Polygon([*there, *back[1:]])
