"""The walls of a floor as a triangulation, on which shortest paths through free space are searched."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats, Longs
from robocorba.map_editor.spatial.grids import Grid
from robocorba.map_editor.spatial.pose import XY
from robocorba.planning.dead_ends import exit_triangles
from robocorba.planning.triangulation import crossings, empty_mesh, insert_points, insert_walls, trimmed

#: Angles that differ by less are equal [rad].
SAME_RAD = 1e-7


class FloorMesh:
    """The triangulated walls of a floor; the same for robots of any radius."""

    def __init__(self, grid: Grid, bounded: bool, points: Sequence[XY] = ()) -> None:
        """The mesh covers the walls, `points` [m] and, unless an outline bounds the floor, the surrounding ground."""
        segments = grid.segments
        self.bounds = _bounds(segments, points, bounded)
        crossed_at = crossings(grid)
        mesh = empty_mesh(self.bounds, 2 * len(segments) + len(crossed_at))
        insert_points(mesh, crossed_at)
        wall_ends, vertices = segments.reshape(-1, 2), np.empty(2 * len(segments), np.int64)
        insert_walls(mesh, segments, _order(wall_ends), vertices)
        self.mesh = trimmed(mesh)
        #: The vertices (n, 2) [m].
        self.xy: Floats = self.mesh.frame[:2] + self.mesh.frame[2] * self.mesh.at
        self.xy[vertices[::-1]] = wall_ends[::-1]
        #: Maximum distance between ends of walls that share a vertex [m].
        self.merged_m = float(np.abs(self.xy[vertices] - wall_ends).max(initial=0.0))
        self.exit_triangle = exit_triangles(self.mesh)
        self.low, self.span = wall_arcs(len(self.xy), segments, vertices)

    def covers(self, points: Sequence[XY]) -> bool:
        """Whether the mesh covers all these points."""
        x0, y0, x1, y1 = self.bounds
        return all(x0 <= x <= x1 and y0 <= y <= y1 for x, y in points)


def _bounds(segments: Floats, points: Sequence[XY], bounded: bool) -> tuple[float, float, float, float]:
    covered = np.concatenate([segments.reshape(-1, 2), np.array(points, float).reshape(-1, 2)])
    if not len(covered):
        covered = np.zeros((1, 2))
    low, high = covered.min(axis=0), covered.max(axis=0)
    around = 1.0 if bounded else 51.0 + float((high - low).max())  # [m]; without an outline paths may lead far around
    return float(low[0] - around), float(low[1] - around), float(high[0] + around), float(high[1] + around)


def _order(points: Floats) -> Longs:
    """An order in which consecutive points are close: row by row of a grid, in alternating directions."""
    if not len(points):
        return np.empty(0, np.int64)
    low, extent = points.min(axis=0), max(float(np.ptp(points, axis=0).max()), 1e-9)
    rows = max(int(math.sqrt(len(points) / 2)), 1)
    row = ((points[:, 1] - low[1]) / extent * rows).astype(np.int64)
    along = np.where(row % 2, -points[:, 0], points[:, 0])
    return np.lexsort((along, row)).astype(np.int64)


def wall_arcs(vertices: int, segments: Floats, ends: Longs) -> tuple[Floats, Floats]:
    """low (n,) and span (n,): the arc of each vertex on which a robot touches none of the walls that meet there
    [rad]; the span is negative where there is none. ends (2m,) are the vertices of segments (m, 4)."""
    a, b = ends[0::2], ends[1::2]
    there = np.arctan2(segments[:, 3] - segments[:, 1], segments[:, 2] - segments[:, 0])
    back = np.where(there <= 0.0, there + math.pi, there - math.pi)
    vertex, angle = np.concatenate([a[a != b], b[a != b]]), np.concatenate([there[a != b], back[a != b]])
    order = np.lexsort((angle, vertex))
    vertex, angle = vertex[order], angle[order]
    low, span = np.zeros(vertices), np.full(vertices, -1.0)
    if len(vertex):
        is_first = np.diff(vertex, prepend=-1) != 0
        following = np.roll(angle, -1)
        following[np.roll(is_first, -1)] = angle[is_first] + 2 * math.pi
        gap = following - angle
        wide = gap > math.pi + SAME_RAD
        low[vertex[wide]], span[vertex[wide]] = angle[wide] + math.pi / 2, gap[wide] - math.pi
    return low, span
