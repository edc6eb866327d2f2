"""What a robot can certainly reach on a floor, by shapely and a fine grid, without the planner's kernels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage
from shapely import LineString, Point, Polygon, STRtree

from robocorba.maps.geometry import bounds, obstacles
from robocorba.maps.model import Building
from robocorba.spatial.pose import XY
from robocorba.testing.grid_maps import Cell, OctileGraph

#: Tolerance for rounding [m].
FORGIVEN_M = 1e-6
#: Side of a cell [m].
GRID_CELL_M = 0.04
#: Clearance beyond the radius that every path on the grid keeps [m]; obstacles grown by polygons need less.
SPARE_M = 0.01
#: Clearance beyond the radius at the centre of a free cell [m]: a move to the next cell may lose half a cell of it. See
#: OctileGraph for diagonal moves.
GRID_MARGIN_M = SPARE_M + GRID_CELL_M / 2
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
        """The same as sentences."""
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
        limit = radius_m - FORGIVEN_M
        if limit <= 0.0:
            return self.tree.query(shapes, "crosses")
        return self.tree.query(shapes, "dwithin", limit)


class FineGrid:
    """Cells whose centres keep radius + GRID_MARGIN_M from all obstacles; `labels` numbers connected parts from 1."""

    def __init__(self, floor: FloorGeometry, radius_m: float, without_lanes: bool) -> None:
        self._floor, self._radius = floor, radius_m
        margin = radius_m + GRID_MARGIN_M + 10 * GRID_CELL_M
        x0, y0, x1, y1 = bounds(floor.building, floor.name, margin if floor.outline is None else 0.0)
        self._origin = np.array([x0, y0])
        self.is_open = floor.outline is None
        rows, columns = math.ceil((y1 - y0) / GRID_CELL_M), math.ceil((x1 - x0) / GRID_CELL_M)
        self._x = x0 + (np.arange(columns) + 0.5) * GRID_CELL_M
        self._y = y0 + (np.arange(rows) + 0.5) * GRID_CELL_M
        self.free = np.ones((rows, columns), np.bool_)
        self._block_lines(floor.shapes, radius_m + GRID_MARGIN_M)
        self._block_insides([shape for shape in floor.shapes if shape.geom_type == "Polygon"])
        if floor.outline is not None:
            self.free &= shapely.contains_xy(floor.outline, *np.meshgrid(self._x, self._y))
        if without_lanes:
            self._block_lines(np.array(floor.lanes, object), radius_m + GRID_MARGIN_M)
        self._lanes = floor.lanes if without_lanes else []
        self.labels, self.count = ndimage.label(self.free)
        self._links: dict[XY, list[tuple[Cell, float]]] = {}

    def _block_lines(self, shapes: NDArray[np.object_], reach_m: float) -> None:
        """Block the cells whose centres are within reach of the shapes' lines."""
        for part in shapely.get_parts(
            shapely.get_parts(np.where(shapely.get_dimensions(shapes) == 2, shapely.boundary(shapes), shapes))
        ):
            at = shapely.get_coordinates(part)
            for a, b in pairwise(at):
                low, high = np.minimum(a, b) - reach_m, np.maximum(a, b) + reach_m
                left, right = np.searchsorted(self._x, (low[0], high[0]))
                bottom, top = np.searchsorted(self._y, (low[1], high[1]))
                x, y = self._x[left:right] - a[0], self._y[bottom:top, None] - a[1]
                d = b - a
                square = float(d @ d)
                t = (
                    np.clip((x * d[0] + y * d[1]) / square, 0.0, 1.0)
                    if square
                    else np.zeros((top - bottom, right - left))
                )
                near = (x - t * d[0]) ** 2 + (y - t * d[1]) ** 2 < reach_m**2
                self.free[bottom:top, left:right] &= ~near

    def _block_insides(self, solids: Sequence[Polygon]) -> None:
        for solid in solids:
            x0, y0, x1, y1 = solid.bounds
            left, right = np.searchsorted(self._x, (x0, x1))
            bottom, top = np.searchsorted(self._y, (y0, y1))
            inside = shapely.contains_xy(solid, *np.meshgrid(self._x[left:right], self._y[bottom:top]))
            self.free[bottom:top, left:right] &= ~inside

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
        if self._lanes and any(lane.distance(Point(at)) <= self._radius + GRID_MARGIN_M for lane in self._lanes):
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
