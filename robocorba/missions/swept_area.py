"""What a carry takes of the floors: where the object and its carriers come by, for their leader to reserve."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.maps.polygons import FloorArea
from robocorba.missions.carry import Leg
from robocorba.missions.formation import Formation, Pose
from robocorba.missions.surroundings import placed
from robocorba.spatial.pose import XY

#: The body is looked at so near along its way, m and rad.
_LOOK_M, _LOOK_RAD = 0.25, 0.2
#: How coarse an area may be, m: the first that has few enough corners.
_COARSE_M = (0.05, 0.15, 0.5)
_MOST_CORNERS = 100


def taken(legs: Sequence[Leg], formation: Formation, outline: Polygon, aside_m: float) -> tuple[FloorArea, ...]:
    """An area (floor, corners in m) for each leg: all that the body comes by on its way, and where it is taken up and
    put down the room in which its carriers gather, `aside_m` farther away from it.

    outline: of the object, in its own frame."""
    body = formation.footprint(outline)
    gathered = Formation(formation.grips, formation.hand_m + aside_m).footprint(outline)
    found = []
    for number, leg in enumerate(legs):
        poses = [(x, y, heading) for x, y, heading in np.asarray(leg.poses, float).tolist()]
        shapes = _swept(body, poses)
        if number == 0:
            shapes.append(placed(gathered, poses[0]).convex_hull)
        if number == len(legs) - 1:
            shapes.append(placed(gathered, poses[-1]).convex_hull)
        found.append((leg.floor, _corners(shapely.union_all(shapes))))
    return tuple(found)


def _swept(body: BaseGeometry, poses: Sequence[Pose]) -> list[BaseGeometry]:
    """Hulls of the body between places that are near to each other."""
    hulls = [placed(body, pose).convex_hull for pose in _between(poses)]
    return [shapely.union_all(pair).convex_hull for pair in pairwise(hulls)] or hulls


def _between(poses: Sequence[Pose]) -> list[Pose]:
    found = [poses[0]]
    for here, there in pairwise(poses):
        parts = 1 + int(max(math.dist(here[:2], there[:2]) / _LOOK_M, abs(there[2] - here[2]) / _LOOK_RAD))
        for part in range(1, parts + 1):
            x, y, heading = (a + part / parts * (b - a) for a, b in zip(here, there, strict=True))
            found.append((x, y, heading))
    return found


def _corners(shape: BaseGeometry) -> tuple[XY, ...]:
    """Of a polygon with few corners around a shape that is in one piece."""
    for coarse_m in _COARSE_M:
        around = Polygon(shape.buffer(coarse_m, quad_segs=2).exterior).simplify(coarse_m)
        if len(around.exterior.coords) <= _MOST_CORNERS:
            break
    else:
        around = shape.convex_hull
    return tuple((x, y) for x, y in shapely.get_coordinates(around.exterior)[:-1].tolist())
