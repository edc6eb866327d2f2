"""What a carried object and its carriers must not touch on a floor."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import shapely
import shapely.affinity
from shapely import Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from robocorba.maps.geometry import Obstacle, obstacles
from robocorba.maps.model import Building
from robocorba.maps.movable import landing_doors, movables
from robocorba.missions.formation import Pose
from robocorba.spatial.grids import Grid, build_grid, segments_of

#: What stands somewhere besides, by floor: with a name, or just a shape.
Blocked = Mapping[str, Sequence[Obstacle | BaseGeometry]]
#: How far a way leads beyond everything on a floor without bounds, m.
AROUND_M = 4.0


class Nearest(NamedTuple):
    """The obstacle nearest to a footprint, how far it is, m, and where."""

    item: Obstacle
    distance_m: float
    x: float
    y: float


class Ground:
    """A floor with what stands on it."""

    def __init__(self, floor: str, found: Sequence[Obstacle], outline: Polygon | None) -> None:
        self.floor, self.found, self.outline = floor, found, outline
        self._tree = STRtree([item.geometry for item in found])

    @cached_property
    def grid(self) -> Grid:
        return build_grid(segments_of(np.array([item.geometry for item in self.found], object))[0])

    def box(self, *poses: Pose) -> tuple[float, float, float, float]:
        """What a way between these may need: x0, y0, x1, y1."""
        if self.outline is not None:
            return self.outline.bounds
        points = [shapely.Point(pose[0], pose[1]) for pose in poses]
        x0, y0, x1, y1 = shapely.total_bounds([*(item.geometry for item in self.found), *points])
        return float(x0 - AROUND_M), float(y0 - AROUND_M), float(x1 + AROUND_M), float(y1 + AROUND_M)

    def nearest(self, footprint: BaseGeometry, margin_m: float) -> Nearest | None:
        """What is nearer than `margin_m` to a footprint, or in it; the bounds of the floor where it is beyond them."""
        near = [
            (float(shapely.distance(self.found[i].geometry, footprint)), i)
            for i in self._tree.query(footprint, predicate="dwithin", distance=margin_m)
        ]
        near = [(distance, i) for distance, i in near if distance < margin_m - 1e-9 or distance == 0.0]
        if near:
            distance, i = min(near)
            item = self.found[i]
            x, y = shapely.get_coordinates(shapely.shortest_line(item.geometry, footprint))[0].tolist()
            return Nearest(item, distance, x, y)
        if self.outline is not None and not self.outline.covers(footprint):
            x, y = shapely.get_coordinates(footprint.centroid)[0].tolist()
            return Nearest(Obstacle("floor", self.floor, self.outline.exterior), 0.0, x, y)
        return None


class Surroundings:
    """The floors of a building without what is carried; `carried` is its name among the movables of the map.

    What `blocked` has under the name of another movable object stands there instead of where the map has it."""

    def __init__(self, building: Building, carried: str, blocked: Blocked) -> None:
        self.building = building
        self._blocked = blocked
        elsewhere = {
            item.name for items in blocked.values() for item in items if isinstance(item, Obstacle) and item.name
        }
        known = movables(building)
        self._gone = {(known[name][1], known[name][0].name) for name in {carried, *elsewhere} if name in known}
        self._grounds: dict[tuple[str, frozenset[str]], Ground] = {}

    def ground(self, floor: str, open_elevators: frozenset[str] = frozenset()) -> Ground:
        """A floor where the doors of these elevators are open, and those of all others shut."""
        key = (floor, open_elevators)
        if key not in self._grounds:
            found = [
                item
                for item in obstacles(self.building, floor)
                if not (item.kind == "object" and (floor, item.name) in self._gone)
            ]
            for item in self._blocked.get(floor, ()):
                found.append(item if isinstance(item, Obstacle) else Obstacle("obstacle", "", item))
            for name, elevator in self.building.elevators.items():
                if floor in elevator.floors() and name not in open_elevators:
                    found.append(Obstacle("elevator", name, landing_doors(self.building, name, floor)))
            found = [item for item in found if not item.geometry.is_empty]
            outline = self.building.floors[floor].floor.outline
            self._grounds[key] = Ground(floor, found, Polygon(outline) if outline else None)
        return self._grounds[key]


def placed(shape: BaseGeometry, pose: Pose) -> BaseGeometry:
    """A shape of a body's frame where the body is, in the floor's frame."""
    x, y, heading = pose
    cos, sin = math.cos(heading), math.sin(heading)
    return shapely.affinity.affine_transform(shape, [cos, -sin, sin, cos, x, y])
