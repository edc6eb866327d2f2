"""Geometry as Foxglove's messages: poses, and the primitives of SmartPal's parts and of extruded outlines."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import shapely
from foxglove.messages import (
    Color,
    CubePrimitive,
    CylinderPrimitive,
    Duration,
    Point3,
    Pose,
    Quaternion,
    SpherePrimitive,
    Timestamp,
    TriangleListPrimitive,
    Vector3,
)
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.spatial.pose import XY
from robocorba.robot.kinematics.appearance import PAINTS, Part, Shape

#: Entities stay until they are deleted.
FOREVER = Duration(sec=0)
NS_PER_S = 1_000_000_000
#: Thickness with which lines such as walls are drawn [m].
WALL_M = 0.06


def nanoseconds(time_s: float) -> int:
    """A simulated time as Foxglove's times [ns]."""
    return round(time_s * NS_PER_S)


def timestamp(time_s: float) -> Timestamp:
    """A simulated time [s]."""
    return Timestamp(*divmod(nanoseconds(time_s), NS_PER_S))


def vector(xyz: Sequence[float]) -> Vector3:
    x, y, z = xyz
    return Vector3(x=x, y=y, z=z)


def yaw(heading: float) -> Quaternion:
    """A turn about the vertical axis [rad]."""
    return Quaternion(x=0.0, y=0.0, z=math.sin(heading / 2), w=math.cos(heading / 2))


def pose(x: float, y: float, z: float, heading: float = 0.0) -> Pose:
    """A pose [m, rad]."""
    return Pose(position=vector((x, y, z)), orientation=yaw(heading))


def rpy(roll: float, pitch: float, yaw: float) -> Quaternion:
    """The attitude after turns about the fixed axes x, y and z, in this order [rad]."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(angle / 2), math.cos(angle / 2)) for angle in (roll, pitch, yaw))
    return Quaternion(
        x=sr * cp * cy - cr * sp * sy,
        y=cr * sp * cy + sr * cp * sy,
        z=cr * cp * sy - sr * sp * cy,
        w=cr * cp * cy + sr * sp * sy,
    )


def colour(rgb: Sequence[float], opacity: float = 1.0) -> Color:
    """Red, green and blue from 0 to 1."""
    r, g, b = rgb
    return Color(r=r, g=g, b=b, a=opacity)


class Primitives:
    """Primitives of an entity, in its frame."""

    def __init__(self) -> None:
        self.cubes: list[CubePrimitive] = []
        self.cylinders: list[CylinderPrimitive] = []
        self.spheres: list[SpherePrimitive] = []
        self.triangles: list[TriangleListPrimitive] = []

    def add_part(self, part: Part) -> None:
        """A part of the robot, in the frame of its link."""
        at = Pose(position=vector(part.at), orientation=rpy(*part.rpy))
        paint = colour(PAINTS[part.paint])
        if part.shape is Shape.BOX:
            self.cubes.append(CubePrimitive(pose=at, size=vector(part.size), color=paint))
        elif part.shape is Shape.ELLIPSOID:
            size = vector([2 * radius for radius in part.size])
            self.spheres.append(SpherePrimitive(pose=at, size=size, color=paint))
        else:
            radius_x, radius_y, top, height = part.size
            widest = max(1.0, top)
            size = vector((2 * radius_x * widest, 2 * radius_y * widest, height))
            self.cylinders.append(
                CylinderPrimitive(pose=at, size=size, bottom_scale=1 / widest, top_scale=top / widest, color=paint)
            )

    def add_wall(self, a: XY, b: XY, bottom_m: float, height_m: float, paint: Color) -> None:
        """A thin upright wall from a to b [m]."""
        along = (b[0] - a[0], b[1] - a[1])
        at = pose((a[0] + b[0]) / 2, (a[1] + b[1]) / 2, bottom_m + height_m / 2, math.atan2(along[1], along[0]))
        size = vector((math.hypot(*along) + WALL_M, WALL_M, height_m))
        self.cubes.append(CubePrimitive(pose=at, size=size, color=paint))

    def add_walls(self, lines: BaseGeometry, bottom_m: float, height_m: float, paint: Color) -> None:
        """Thin upright walls along lines, and around polygons [m]."""
        for part in shapely.get_parts(lines):
            edge = part.exterior if isinstance(part, Polygon) else part
            points = [(float(x), float(y)) for x, y in shapely.get_coordinates(edge)]
            for a, b in itertools.pairwise(points):
                self.add_wall(a, b, bottom_m, height_m, paint)

    def add_plate(self, area: BaseGeometry, height_m: float, paint: Color) -> None:
        """A horizontal area at a height [m], seen from both sides."""
        self._add_triangles(_triangles(area, height_m), paint)

    def add_block(self, area: BaseGeometry, bottom_m: float, height_m: float, paint: Color) -> None:
        """An upright block with this area [m]."""
        corners = [_triangles(area, bottom_m + height_m)]
        for part in shapely.get_parts(area):
            ring = shapely.get_coordinates(part.exterior)
            a, b = ring[:-1], ring[1:]
            low, high = np.full((len(a), 1), bottom_m), np.full((len(a), 1), bottom_m + height_m)
            sides = [np.hstack(each) for each in ((a, low), (b, low), (b, high), (a, low), (b, high), (a, high))]
            corners.append(np.stack(sides, axis=1).reshape(-1, 3))
        self._add_triangles(np.vstack(corners), paint)

    def _add_triangles(self, corners: np.ndarray, paint: Color) -> None:
        points = [Point3(x=x, y=y, z=z) for x, y, z in corners.tolist()]
        self.triangles.append(TriangleListPrimitive(pose=pose(0.0, 0.0, 0.0), points=points, color=paint))


def _triangles(area: BaseGeometry, height_m: float) -> np.ndarray:
    """Corners (n, 3) of triangles that cover a polygon at a height, three for each."""
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(area))
    corners = np.array([shapely.get_coordinates(part)[:3] for part in parts]).reshape(-1, 2)
    return np.hstack((corners, np.full((len(corners), 1), height_m)))
