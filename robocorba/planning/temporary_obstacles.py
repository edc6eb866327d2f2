"""Temporary obstacles of a path request, which are not on the map, and errors that name them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import shapely

from robocorba.errors.paths import Blocker, NoPath, NotFree, PathError
from robocorba.map_editor.polygons import FloorArea
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.request import PathRequest

#: How the path planning agent names the forbidden areas of a request, which it counts from 0.
_AREA = re.compile(r"forbidden area (\d+)")


class TemporaryObstacles(NamedTuple):
    """Fields of a PathRequest: polygons on floors [m], and floors whose movable objects are all among the polygons, so
    that the planner ignores these objects' places on the map. names: of the object or robot of each polygon."""

    forbidden_areas: tuple[FloorArea, ...] = ()
    without_movables: tuple[str, ...] = ()
    names: tuple[str, ...] = ()

    def without(self, name: str) -> TemporaryObstacles:
        """These obstacles without one of them, whose place is unknown; without all if `name` is empty."""
        kept = [i for i, other in enumerate(self.names) if name and other != name]
        areas, names = tuple(self.forbidden_areas[i] for i in kept), tuple(self.names[i] for i in kept)
        return TemporaryObstacles(areas, self.without_movables, names)

    def added_to(self, request: PathRequest) -> PathRequest:
        """The request for a path around these obstacles."""
        return request._replace(forbidden_areas=self.forbidden_areas, without_movables=self.without_movables)

    def near_line(self, floor: str, points: Sequence[XY], radius_m: float) -> list[str]:
        """Names of the obstacles on a floor that a robot of this radius touches on a line [m] through the points."""
        line = shapely.LineString([*points, points[-1]])
        return [
            name
            for name, (where, corners) in zip(self.names, self.forbidden_areas, strict=True)
            if where == floor and shapely.Polygon(corners).distance(line) < radius_m
        ]

    def explained(self, error: PathError) -> PathError:
        """The planner's error for a request with these obstacles, with their names in place of their numbers."""
        if isinstance(error, NotFree):
            if (name := self._name_of(error.obstacle)) is None:
                return error
            obstacle = f"{name}, which stands there now"
            return NotFree(error.which, error.floor, error.x, error.y, obstacle, error.clearance_m, error.required_m)
        names = [self._name_of(blocker.name) for blocker in error.blockers] if isinstance(error, NoPath) else []
        if not isinstance(error, NoPath) or not any(names):
            return error
        blockers = [
            Blocker("object", blocker.floor, name, "stands in the way now") if name else blocker
            for blocker, name in zip(error.blockers, names, strict=True)
        ]
        unique = {(blocker.kind, blocker.floor, blocker.name): blocker for blocker in blockers}
        return NoPath("objects and robots at their present places block every path", list(unique.values()))

    def _name_of(self, obstacle: str) -> str | None:
        found = _AREA.fullmatch(obstacle)
        return self.names[int(found[1])] if found and int(found[1]) < len(self.names) else None


NO_OBSTACLES = TemporaryObstacles()
