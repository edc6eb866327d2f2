"""Obstacles on each floor for a carried object and its carriers."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
import shapely
import shapely.affinity
from shapely import Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from robocorba.map_editor.geometry import Obstacle, obstacles, shaft_polygon
from robocorba.map_editor.model import Building
from robocorba.map_editor.movable import landing_doors, movables
from robocorba.map_editor.spatial.grids import Grid, build_grid, segments_of
from robocorba.map_editor.spatial.pose import Pose2D
from robocorba.system.lazy_property import lazy_property

#: Obstacles in addition to the map, by floor: with a name, or just shapes.
Blocked = Mapping[str, Sequence[Obstacle | BaseGeometry]]


class FloorObstacles:
    """The obstacles of one floor. outline: of the floor, None if it has no bounds."""

    def __init__(self, floor: str, found: Sequence[Obstacle], outline: Polygon | None) -> None:
        self.floor, self.found, self.outline = floor, found, outline
        self._tree = STRtree([item.geometry for item in found])

    @lazy_property
    def grid(self) -> Grid:
        return build_grid(segments_of(np.array([item.geometry for item in self.found], object))[0])

    def box(self, *poses: Pose2D) -> tuple[float, float, float, float]:
        """The bounds of all paths between these poses: x0, y0, x1, y1 [m]."""
        if self.outline is not None:
            return self.outline.bounds
        points = [shapely.Point(pose[0], pose[1]) for pose in poses]
        x0, y0, x1, y1 = shapely.total_bounds([*(item.geometry for item in self.found), *points])
        around_m = 4.0  # of free floor that paths may use
        return float(x0 - around_m), float(y0 - around_m), float(x1 + around_m), float(y1 + around_m)

    def nearest(self, footprint: BaseGeometry, margin_m: float) -> tuple[Obstacle, float] | None:
        """The nearest obstacle that overlaps a footprint or is nearer to it than `margin_m`, with its distance [m];
        else the floor's outline if the footprint crosses it, else None."""
        near = [
            (float(shapely.distance(self.found[i].geometry, footprint)), i)
            for i in self._tree.query(footprint, predicate="dwithin", distance=margin_m)
        ]
        near = [(distance, i) for distance, i in near if distance < margin_m - 1e-9 or distance == 0.0]
        if near:
            distance, i = min(near)
            return self.found[i], distance
        if self.outline is not None and not self.outline.covers(footprint):
            return Obstacle("floor", self.floor, self.outline.exterior), 0.0
        return None


class BuildingObstacles:
    """The obstacles of a building without the object `carried`, by its name in `movables`.

    A movable object that is in `blocked` is taken from there, not from the map."""

    def __init__(self, building: Building, carried: str, blocked: Blocked) -> None:
        self.building = building
        self._blocked = blocked
        moved = {item.name for items in blocked.values() for item in items if isinstance(item, Obstacle)}
        #: Floor and name of the objects that are not at their places on the map.
        self._removed = {
            (floor, entry.name) for name, (entry, floor) in movables(building).items() if name in {carried, *moved}
        }
        self._floors: dict[tuple[str, frozenset[str]], FloorObstacles] = {}

    def on_floor(self, floor: str, open_elevators: frozenset[str] = frozenset()) -> FloorObstacles:
        """The obstacles of a floor; landing doors are closed except those of `open_elevators`."""
        key = (floor, open_elevators)
        if key not in self._floors:
            found = [
                item
                for item in obstacles(self.building, floor)
                if not (item.kind == "object" and (floor, item.name) in self._removed)
            ]
            for item in self._blocked.get(floor, ()):
                found.append(item if isinstance(item, Obstacle) else Obstacle("obstacle", "", item))
            for name, elevator in self.building.elevators.items():
                if floor in elevator.floors() and name not in open_elevators:
                    found.append(Obstacle("elevator", name, landing_doors(self.building, name, floor)))
            found = [item for item in found if not item.geometry.is_empty]
            outline = self.building.floors[floor].floor.outline
            self._floors[key] = FloorObstacles(floor, found, Polygon(outline) if outline else None)
        return self._floors[key]

    def held_open(self, floor: str, outline: BaseGeometry, pose: Pose2D) -> frozenset[str]:
        """The elevators whose doors on a floor cannot close, since an object with this outline in its own frame stands
        between them, or in the cabin."""
        shape, origin = placed(outline, pose), shapely.Point(pose[:2])
        return frozenset(
            name
            for name, elevator in self.building.elevators.items()
            if floor in elevator.floors()
            and (
                shaft_polygon(elevator).contains(origin) or landing_doors(self.building, name, floor).intersects(shape)
            )
        )


def placed(shape: BaseGeometry, pose: Pose2D) -> BaseGeometry:
    """A shape from the frame of a body at `pose` to the floor's frame."""
    x, y, heading = pose
    cos, sin = math.cos(heading), math.sin(heading)
    return shapely.affinity.affine_transform(shape, [cos, -sin, sin, cos, x, y])
