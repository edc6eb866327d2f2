"""The free space of one floor, compiled: whether a point is free, and whether a robot can drive along a line.

All obstacles become line segments in a uniform grid, and a query tests only the cells that it touches. Distances are
exact, and the kernels run without the GIL.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from robocorba.map_editor.geometry import Obstacle, obstacles
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.grids import Grid, build_grid, column_of, row_of, segments_of, span
from robocorba.map_editor.spatial.pose import XY
from robocorba.map_editor.vicinity import named_obstacles
from robocorba.planning.floor_mesh import FloorMesh
from robocorba.planning.floor_source import FloorSource
from robocorba.planning.segments import segments_distance2
from robocorba.system.kernels import inner_kernel, kernel

#: Tolerance for rounding where a robot touches what it passes [m].
TOUCH_M = 1e-9


class FloorSpace:
    """The free space of one floor.

    `grid` holds the segments of all obstacles; `owners` are the obstacles. `borders` are the sides of the outline
    and of all solid objects, ring after ring; `rings` (k, 6) has the bounding box of each ring (min x, min y, max x,
    max y in m), its first side and its number of sides, the outline first; `inside` is 1 if there is an outline."""

    def __init__(self, building: Building, floor: str, before: FloorSpace | None = None) -> None:
        """With `before`, the space of the same floor in an earlier building, only the differences are recomputed."""
        entry = building.floors[floor]
        self.floor, self.source = floor, FloorSource(building, floor)
        touched = self.source.touched_since(before.source, building) if before else None
        if before is None or touched is None:
            self.owners: Sequence[Obstacle] = obstacles(building, floor)
            segments, self._owner_of = segments_of(np.array([item.geometry for item in self.owners], object))
            self._is_ring = _are_rings(self.owners)
        else:
            segments = self._changed(before, touched, building)
        self.grid = build_grid(segments)
        self.inside = int(bool(entry.floor.outline))
        self.borders, self.rings = self._rings(segments)
        self._mesh: FloorMesh | None = None
        self._lock = threading.Lock()

    def _changed(self, before: FloorSpace, changed: set[tuple[str, str]], building: Building) -> Floats:
        """Keep the obstacles that were not touched and add the changed ones, (kind, name); returns all segments."""
        names, owners = {name for _, name in changed}, list(before.owners)
        removed = [i for i, item in enumerate(owners) if item.name in names and (item.kind, item.name) in changed]
        for i in reversed(removed):
            del owners[i]
        stays = np.ones(len(before.owners), bool)
        stays[removed] = False
        added = named_obstacles(building, self.floor, changed)
        segments, owner_of = segments_of(np.array([item.geometry for item in added], object))
        kept, number = stays[before._owner_of], np.cumsum(stays) - 1
        self._owner_of = np.concatenate([number[before._owner_of[kept]], owner_of + len(owners)]).astype(np.int64)
        self.owners = [*owners, *added]
        self._is_ring = np.concatenate([before._is_ring[stays], _are_rings(added)])
        return np.concatenate([before.grid.segments[kept], segments])

    def _rings(self, segments: Floats) -> tuple[Floats, Floats]:
        """`borders` and `rings`."""
        sides = np.flatnonzero(self._is_ring[self._owner_of])
        if not len(sides):
            return np.empty((0, 4)), np.empty((0, 6))
        outline = next((i for i in reversed(range(len(self.owners))) if self.owners[i].kind == "floor"), -1)
        order = np.where(self._owner_of[sides] == outline, -1, self._owner_of[sides])
        sides = sides[np.argsort(order, kind="stable")]
        borders, owner = segments[sides], self._owner_of[sides]
        first = np.flatnonzero(np.diff(owner, prepend=-1))
        low, high = np.minimum(borders[:, :2], borders[:, 2:]), np.maximum(borders[:, :2], borders[:, 2:])
        boxes = [np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)]
        return borders, np.column_stack([*boxes, first, np.diff(first, append=len(borders))])

    def mesh(self, points: Sequence[XY]) -> FloorMesh:
        """A triangulation of all obstacles that covers these points, made on first use."""
        with self._lock:
            if self._mesh is None or not self._mesh.covers(points):
                self._mesh = FloorMesh(self.grid, bool(self.inside), points)
            return self._mesh

    def is_ground(self, x: float, y: float) -> bool:
        """Whether a point lies inside the outline and outside every solid object."""
        return bool(is_ground(self.borders, self.rings, self.inside, x, y))

    def point_is_free(self, x: float, y: float, radius_m: float) -> bool:
        """Whether a robot of this radius [m] fits at a point."""
        return bool(point_is_free(self.grid, self.borders, self.rings, self.inside, x, y, radius_m))

    def nearest(self, x: float, y: float, reach_m: float) -> tuple[float, Obstacle | None]:
        """The nearest obstacle and its distance [m]; (reach_m, None) if none is nearer."""
        return self.nearest_to_line(x, y, x, y, reach_m)

    def nearest_to_line(
        self, ax: float, ay: float, bx: float, by: float, reach_m: float
    ) -> tuple[float, Obstacle | None]:
        """The nearest obstacle to the line from a to b and its distance [m]; (reach_m, None) if none is nearer."""
        distance, segment = line_clearance(self.grid, ax, ay, bx, by, reach_m)
        return float(distance), None if segment < 0 else self.owners[self._owner_of[segment]]

    def line_is_free(self, ax: float, ay: float, bx: float, by: float, radius_m: float) -> bool:
        """Whether a robot of this radius [m] can drive straight from a to b, both on the ground."""
        return bool(line_free(self.grid, ax, ay, bx, by, radius_m))


def _are_rings(items: Sequence[Obstacle]) -> NDArray[np.bool_]:
    """Which obstacles enclose an area: solid objects and the outline."""
    solid = np.isin(
        shapely.get_type_id(np.array([item.geometry for item in items], object)), shapely.GeometryType.POLYGON
    )
    return solid | np.array([item.kind == "floor" for item in items], bool)


@kernel
def line_clearance(grid: Grid, ax: float, ay: float, bx: float, by: float, reach: float) -> tuple[float, int]:
    """Distance from the line ab to the nearest segment [m] and its index; (reach, -1) if none is nearer."""
    segments, start, items, frame = grid
    best, nearest = reach * reach, -1
    columns = int(frame[3])
    for row in range(row_of(frame, min(ay, by) - reach), row_of(frame, max(ay, by) + reach) + 1):
        low = frame[1] + row * frame[2] - reach
        left, right = span(ax, ay, bx, by, low, low + frame[2] + 2 * reach)
        for column in range(column_of(frame, left - reach), column_of(frame, right + reach) + 1):
            cell = row * columns + column
            for i in range(start[cell], start[cell + 1]):
                s = items[i]
                distance2 = segments_distance2(
                    ax, ay, bx, by, segments[s, 0], segments[s, 1], segments[s, 2], segments[s, 3]
                )
                if distance2 < best:
                    best, nearest = distance2, s
    return math.sqrt(best), nearest


@kernel
def line_free(grid: Grid, ax: float, ay: float, bx: float, by: float, radius: float) -> bool:
    """Whether no segment is nearer than `radius` to the line ab."""
    segments, start, items, frame = grid
    reach = max(radius - TOUCH_M, 0.0)
    limit = reach * reach
    columns = int(frame[3])
    for row in range(row_of(frame, min(ay, by) - reach), row_of(frame, max(ay, by) + reach) + 1):
        low = frame[1] + row * frame[2] - reach
        left, right = span(ax, ay, bx, by, low, low + frame[2] + 2 * reach)
        for column in range(column_of(frame, left - reach), column_of(frame, right + reach) + 1):
            cell = row * columns + column
            for i in range(start[cell], start[cell + 1]):
                s = items[i]
                distance2 = segments_distance2(
                    ax, ay, bx, by, segments[s, 0], segments[s, 1], segments[s, 2], segments[s, 3]
                )
                if distance2 < limit or distance2 == 0.0:
                    return False
    return True


@inner_kernel
def detour_bound(grid: Grid, ax: float, ay: float, bx: float, by: float) -> float:
    """Lower bound of the length of a path from a to b [m]: it leads around an end of each segment that crosses the
    straight line."""
    segments, start, items, frame = grid
    least = math.hypot(bx - ax, by - ay)
    columns = int(frame[3])
    for row in range(row_of(frame, min(ay, by)), row_of(frame, max(ay, by)) + 1):
        low = frame[1] + row * frame[2]
        left, right = span(ax, ay, bx, by, low, low + frame[2])
        for column in range(column_of(frame, left), column_of(frame, right) + 1):
            cell = row * columns + column
            for i in range(start[cell], start[cell + 1]):
                px, py, qx, qy = segments[items[i]]
                if segments_distance2(ax, ay, bx, by, px, py, qx, qy) > 0.0:
                    continue
                by_p = math.hypot(px - ax, py - ay) + math.hypot(bx - px, by - py)
                by_q = math.hypot(qx - ax, qy - ay) + math.hypot(bx - qx, by - qy)
                least = max(least, min(by_p, by_q))
    return least


@kernel
def is_ground(borders: Floats, rings: Floats, inside: int, x: float, y: float) -> bool:
    """Whether a point lies inside the outline, if there is one, and outside all solid objects; see FloorSpace."""
    for k in range(rings.shape[0]):
        x0, y0, x1, y1 = rings[k, 0], rings[k, 1], rings[k, 2], rings[k, 3]
        odd = False
        if x0 <= x <= x1 and y0 <= y <= y1:
            first = int(rings[k, 4])
            for i in range(first, first + int(rings[k, 5])):
                ax, ay, bx, by = borders[i]
                if (ay > y) != (by > y) and x < ax + (y - ay) / (by - ay) * (bx - ax):
                    odd = not odd
        if odd != (inside == 1 and k == 0):
            return False
    return True


@kernel
def point_is_free(grid: Grid, borders: Floats, rings: Floats, inside: int, x: float, y: float, radius: float) -> bool:
    """Whether a point lies on the ground and no segment is nearer than `radius`."""
    return line_free(grid, x, y, x, y, radius) and is_ground(borders, rings, inside, x, y)
