"""The obstacles of a floor by shapely, without the planner's kernels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import LineString, Point, Polygon, STRtree

from robocorba.map_editor.geometry import obstacles
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.pose import XY

#: Tolerance for rounding [m].
TOLERANCE_M = 1e-6


class FloorGeometry:
    """The obstacles of a floor."""

    def __init__(self, building: Building, name: str) -> None:
        self.building, self.name = building, name
        entry = building.floors[name]
        self.obstacles = obstacles(building, name)
        self.shapes = np.array([item.geometry for item in self.obstacles], object)
        self.tree = STRtree(self.shapes)
        self.outline = Polygon(entry.floor.outline) if entry.floor.outline else None
        if self.outline is not None:
            shapely.prepare(self.outline)

    def point_is_free(self, at: XY, radius_m: float) -> bool:
        return not self.touching([(at, at)], radius_m)

    def clearance(self, at: XY) -> float:
        """Distance from a place to the nearest obstacle [m]."""
        return float(shapely.distance(self.shapes, Point(at)).min(initial=math.inf))

    def touching(self, lines: Sequence[tuple[XY, XY]], radius_m: float) -> set[int]:
        """Indices of the lines that come nearer than the radius to an obstacle, or leave the outline."""
        if not lines:
            return set()
        shapes = self._lines(lines)
        found = set(self._hits(shapes, radius_m)[0].tolist())
        if self.outline is not None:
            found |= set(np.flatnonzero(~shapely.covers(self.outline, shapes)).tolist())
        return found

    def touches(self, lines: Sequence[tuple[XY, XY]], radius_m: float) -> list[str]:
        """The same, one sentence for each obstacle."""
        shapes = self._lines(lines)
        found = []
        for i, k in self._hits(shapes, radius_m).T:
            item, (a, b) = self.obstacles[k], lines[i]
            away = shapes[i].distance(item.geometry)
            found.append(f"{self.name} {a} to {b}: {away:.4f} m to {item.kind} {item.name}, {radius_m:g} m needed")
        if self.outline is not None:
            outside = np.flatnonzero(~shapely.covers(self.outline, shapes))
            found += [f"{self.name} {lines[i][0]} to {lines[i][1]}: leaves the outline" for i in outside.tolist()]
        return found

    def _lines(self, lines: Sequence[tuple[XY, XY]]) -> NDArray[np.object_]:
        return np.array([LineString(ends) if ends[0] != ends[1] else Point(ends[0]) for ends in lines], object)

    def _hits(self, shapes: NDArray[np.object_], radius_m: float) -> NDArray[np.int64]:
        if not len(self.shapes):
            return np.empty((2, 0), np.int64)
        limit = radius_m - TOLERANCE_M
        if limit <= 0.0:
            return self.tree.query(shapes, "crosses")
        return self.tree.query(shapes, "dwithin", limit)
