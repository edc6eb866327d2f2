"""The places that a robot can certainly reach on a floor, by shapely and a fine grid, without the planner's kernels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely import LineString, Point, Polygon, STRtree

from robocorba.map_editor.geometry import bounds, obstacles
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.pose import XY
from testkit.grid_maps import Cell, OctileGraph

#: Tolerance for rounding [m].
TOLERANCE_M = 1e-6
#: Side of a cell [m].
GRID_CELL_M = 0.04
#: Clearance beyond the radius that every path on the grid keeps [m]; obstacles grown by polygons need less.
SPARE_M = 0.01
#: Clearance beyond the radius at the centre of a free cell [m]: a move to the next cell may lose half a cell of it. See
#: OctileGraph for diagonal moves.
GRID_MARGIN_M = SPARE_M + GRID_CELL_M / 2
#: Number of sides for a quarter of the arcs of grown obstacles.
ARC_SIDES = 16
#: A place is on the grid if a straight drive leads to a free cell within this distance [m].
GRID_REACH_M = 0.3
#: Number of nearest free cells that are tried for such a drive.
GRID_TRIES = 64


class FloorGeometry:
    """The obstacles of a floor, and its one-way edges."""

    def __init__(self, building: Building, name: str) -> None:
        self.building, self.name = building, name
        entry = building.floors[name]
        self.obstacles = obstacles(building, name)
        self.shapes = np.array([item.geometry for item in self.obstacles], object)
        self.tree = STRtree(self.shapes)
        self.outline = Polygon(entry.floor.outline) if entry.floor.outline else None
        if self.outline is not None:
            shapely.prepare(self.outline)
        nodes = entry.topological.nodes
        self.lanes = [
            LineString([nodes[edge.a].at, nodes[edge.b].at])
            for edge in entry.topological.edges.values()
            if edge.one_way
        ]

    def point_is_free(self, at: XY, radius_m: float) -> bool:
        return not self.touching([(at, at)], radius_m)

    def is_near_lane(self, a: XY, b: XY, reach_m: float) -> bool:
        """Whether a one-way edge is so near that it may forbid the drive from a to b."""
        line = LineString([a, b])
        return any(line.distance(lane) <= reach_m for lane in self.lanes)

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


class FineGrid:
    """Cells whose centres keep radius + GRID_MARGIN_M from all obstacles and, with `without_lanes`, from one-way edges.
    `labels` numbers the connected parts from 1."""

    def __init__(self, floor: FloorGeometry, radius_m: float, without_lanes: bool) -> None:
        self._floor, self._radius = floor, radius_m
        margin = radius_m + GRID_MARGIN_M + 10 * GRID_CELL_M
        x0, y0, x1, y1 = bounds(floor.building, floor.name, margin if floor.outline is None else 0.0)
        self._origin = np.array([x0, y0])
        self.is_open = floor.outline is None
        rows, columns = math.ceil((y1 - y0) / GRID_CELL_M), math.ceil((x1 - x0) / GRID_CELL_M)
        self._x = x0 + (np.arange(columns) + 0.5) * GRID_CELL_M
        self._y = y0 + (np.arange(rows) + 0.5) * GRID_CELL_M
        self._lanes = floor.lanes if without_lanes else []
        grown = (radius_m + GRID_MARGIN_M) / math.cos(1.5 * math.pi / (4 * ARC_SIDES))  # as in maps.geometry.free_space
        blocked = shapely.buffer([*floor.shapes, *self._lanes], grown, quad_segs=ARC_SIDES)
        space = (floor.outline or shapely.box(x0, y0, x1, y1)).difference(shapely.union_all(blocked))
        shapely.prepare(space)
        self.free = shapely.contains_xy(space, *np.meshgrid(self._x, self._y))
        self.labels, self.count = ndimage.label(self.free)
        self._links: dict[XY, list[tuple[Cell, float]]] = {}

    @cached_property
    def octile(self) -> OctileGraph:
        return OctileGraph(self.free, GRID_CELL_M)

    def parts(self, at: XY) -> set[int]:
        """The connected parts that a straight drive from a place reaches; empty if the grid cannot decide."""
        return {int(self.labels[cell]) for cell, _ in self.links(at)}

    def links(self, at: XY) -> list[tuple[Cell, float]]:
        """The nearest free cell of each part that a straight drive from a place reaches, and its distance [m]."""
        if at not in self._links:
            self._links[at] = self._find_links(at)
        return self._links[at]

    def _find_links(self, at: XY) -> list[tuple[Cell, float]]:
        if not self._floor.point_is_free(at, self._radius):
            return []
        if self._lanes and self._floor.is_near_lane(at, at, self._radius + GRID_MARGIN_M):
            return []
        low, high = self._origin, self._origin + np.array(self.free.shape[::-1]) * GRID_CELL_M
        if self.is_open and (np.any(at < low) or np.any(at > high)):  # there are no obstacles beyond the grid
            inside = np.clip(at, low + GRID_CELL_M, high - GRID_CELL_M)
            column, row = ((inside - low) / GRID_CELL_M).astype(int).tolist()
            return [((row, column), math.dist(at, (self._x[column], self._y[row])))]
        left, right = np.searchsorted(self._x, (at[0] - GRID_REACH_M, at[0] + GRID_REACH_M))
        bottom, top = np.searchsorted(self._y, (at[1] - GRID_REACH_M, at[1] + GRID_REACH_M))
        rows, columns = np.nonzero(self.free[bottom:top, left:right])
        rows, columns = rows + bottom, columns + left
        away = np.hypot(self._x[columns] - at[0], self._y[rows] - at[1])
        # At a place near an obstacle the drive may keep that clearance, but must not pass a narrower gap.
        needed = min(self._floor.clearance(at), self._radius + SPARE_M)
        found: dict[int, tuple[Cell, float]] = {}
        for i in np.argsort(away)[:GRID_TRIES]:
            cell = (int(rows[i]), int(columns[i]))
            part = int(self.labels[cell])
            if part in found:
                continue
            centre = (float(self._x[cell[1]]), float(self._y[cell[0]]))
            if not self._floor.touching([(at, centre)], needed):
                found[part] = (cell, float(away[i]))
        return sorted(found.values(), key=lambda link: link[1])
