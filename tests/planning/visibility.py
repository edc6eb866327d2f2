"""Exact shortest paths of small buildings by a visibility graph, rides included."""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph
from shapely import LineString, Point

from robocorba.map_editor.geometry import free_space
from robocorba.map_editor.model import Building
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.request import Place

Array: TypeAlias = NDArray[np.float64]
#: Vertices nearer to each other are equal [m].
SAME_VERTEX_M = 1e-7
#: Length of an edge between points at the same place [m]: a sparse graph has no edges of length 0.
MIN_EDGE_M = 1e-12


def cabin_place(building: Building, elevator: str, floor: str) -> XY:
    """Place of a robot in a cabin: at the cabin's node, else at its centre."""
    nodes = building.floors[floor].topological.nodes.values()
    return next((node.at for node in nodes if node.elevator == elevator), building.elevators[elevator].at)


class VisibilityGraph:
    """Corners that see each other, cabins and rides, for one radius. Takes seconds for 500 corners of a floor."""

    def __init__(self, building: Building, radius_m: float, arc_sides: int = 12) -> None:
        """`arc_sides`: sides for a quarter of an arc of the grown obstacles; with 12 they are up to 0.5 % too large."""
        self._spaces: dict[str, shapely.Geometry] = {}
        self._points: dict[str, Array] = {}
        self._first: dict[str, int] = {}
        numbers: dict[tuple[str, str], int] = {}
        edges = []
        count = 0
        for floor in building.floors:
            space = free_space(building, floor, radius_m, arc_sides)
            self._spaces[floor] = space.buffer(1e-7)
            shapely.prepare(self._spaces[floor])
            served = [name for name, elevator in building.elevators.items() if floor in elevator.floors()]
            numbers |= {(name, floor): count + i for i, name in enumerate(served)}
            cabins = np.array([cabin_place(building, name, floor) for name in served], float).reshape(-1, 2)
            bends = _bends(space)
            points = np.concatenate([cabins, bends[:, 0]])
            self._points[floor], self._first[floor] = points, count
            a, b = np.triu_indices(len(points), 1)
            touching = np.ones(len(a), np.bool_)
            for at, other in ((a, b), (b, a)):
                corner = at >= len(cabins)
                touching[corner] &= _touches(bends[at[corner] - len(cabins)], points[other[corner]])
            edges.append(self._seen(floor, points, a[touching], b[touching]) + np.array([count, count, 0.0]))
            count += len(points)
        self._count = count
        heights = {name: entry.floor.elevation for name, entry in building.floors.items()}
        rides = [
            (a, b, abs(heights[floor] - heights[other_floor]))
            for (name, floor), a in numbers.items()
            for (other, other_floor), b in numbers.items()
            if name == other and a < b
        ]
        self._edges = np.concatenate([*edges, np.array(rides, float).reshape(-1, 3)])

    def _seen(self, floor: str, points: Array, a: NDArray[np.int64], b: NDArray[np.int64]) -> Array:
        """The pairs of points that see each other (n, 3): their indices and distance [m]."""
        ends = np.stack([points[a], points[b]], axis=1)
        seen = shapely.covers(self._spaces[floor], shapely.linestrings(ends)) if len(ends) else np.empty(0, np.bool_)
        lengths = np.hypot(*(ends[:, 1] - ends[:, 0]).T)
        return np.column_stack([a, b, lengths])[seen]

    def length(self, start: Place, goal: Place) -> float:
        """Length of the shortest path [m]; infinite if there is none, NaN if an end is too near to an obstacle to
        decide."""
        ends = []
        for i, place in enumerate((start, goal)):
            if not shapely.covers(self._spaces[place.floor], Point(place[1:])):
                return math.nan
            points = np.concatenate([self._points[place.floor], [place[1:]]])
            last = len(points) - 1
            seen = self._seen(place.floor, points, np.arange(last), np.full(last, last))
            ends.append(
                np.column_stack(
                    [seen[:, 0] + self._first[place.floor], np.full(len(seen), self._count + i), seen[:, 2]]
                )
            )
        if start.floor == goal.floor and shapely.covers(self._spaces[start.floor], LineString([start[1:], goal[1:]])):
            return math.dist(start[1:], goal[1:])
        edges = np.concatenate([self._edges, *ends])
        edges[:, 2] = np.maximum(edges[:, 2], MIN_EDGE_M)
        size = self._count + 2
        graph = sparse.coo_matrix((edges[:, 2], (edges[:, 0].astype(int), edges[:, 1].astype(int))), shape=(size, size))
        return float(csgraph.dijkstra(graph.tocsr(), directed=False, indices=self._count)[self._count + 1])


def _bends(space: shapely.Geometry) -> Array:
    """(n, 3, 2): the corners of a free space at which a shortest path can turn, and their neighbours on the border."""
    rings = shapely.get_rings(shapely.orient_polygons(shapely.get_parts(space)))  # free space on the left
    found = [np.empty((0, 3, 2))]
    for ring in rings:
        at = shapely.get_coordinates(ring)[:-1]
        # Unions leave vertices that differ only by rounding, at which the ring would not seem to bend.
        at = at[np.hypot(*(at - np.roll(at, 1, axis=0)).T) > SAME_VERTEX_M]
        before, after = np.roll(at, 1, axis=0), np.roll(at, -1, axis=0)
        found.append(np.stack([at, before, after], axis=1)[_cross(at - before, after - at) < 0.0])
    return np.concatenate(found)


def _touches(bends: Array, seen_from: Array) -> NDArray[np.bool_]:
    """Whether a line from a point to a corner passes the obstacle there on one side, like all lines of shortest
    paths."""
    line = bends[:, 0] - seen_from
    before, after = _cross(line, bends[:, 1] - bends[:, 0]), _cross(line, bends[:, 2] - bends[:, 0])
    slack = 1e-9 * (1.0 + np.abs(line).sum(axis=1))
    return ~(((before > slack) & (after < -slack)) | ((before < -slack) & (after > slack)))


def _cross(a: Array, b: Array) -> Array:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
