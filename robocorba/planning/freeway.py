"""Shortest ways through the free space of one floor, for one robot radius.

A shortest way among obstacles turns only at corners of the obstacles grown by the
radius. Those corners are the vertices here; which of them see each other is found out
when the search first asks and kept, so that a floor that nobody crosses costs nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from robocorba.grids import Floats, Grid
from robocorba.kernels import kernel
from robocorba.maps.model import XY
from robocorba.planning.space import FloorSpace, against_one_way, line_free, stands_free

#: Corners are grown by at least this much: without any, a wall would have no corner to turn at, m.
LEAST_GROWTH_M = 0.01
#: A quarter of an arc is drawn with so many sides, outside the true arc: ways are up to 0.5 % longer than the shortest.
ARC_SIDES = 8
#: With more corners than this, sight lines are computed at each use rather than kept.
MOST_KEPT = 1500


class Leg(NamedTuple):
    """A drive on one floor: its length in m (inf where there is none) and its corners, ends included."""

    length: float
    points: list[XY]


class Freeways:
    """The corners of a floor for one radius, and the shortest legs between any of its points."""

    def __init__(
        self,
        space: FloorSpace,
        lanes: Floats,
        radius_m: float,
        window: shapely.Geometry | None = None,
    ) -> None:
        """`lanes` (n, 4) are the floor's one-way edges, which legs obey. With a `window` only corners in it count."""
        self.space, self.lanes, self.radius = space, lanes, radius_m
        self.corners = _corners(space, radius_m, window)
        kept = len(self.corners) if len(self.corners) <= MOST_KEPT else 0
        self._sight = np.empty((kept, kept))
        self._seen = np.zeros(kept, np.bool_)

    def legs(self, origin: XY, targets: Sequence[XY], enough: int = 0) -> list[Leg]:
        """The shortest leg from `origin` to each target; all must be free for the radius.

        With `enough`, only so many of the shortest are sure to be found."""
        if not targets:
            return []
        goals = np.array(targets, float).reshape(-1, 2)
        lengths, last, parent = _spread(
            self.space.grid,
            self.lanes,
            self.corners,
            self._sight,
            self._seen,
            *origin,
            goals,
            min(enough or len(goals), len(goals)),
            self.radius,
        )
        found = []
        for target, length, corner in zip(targets, lengths, last, strict=True):
            points = [target]
            while corner >= 0:
                points.append((float(self.corners[corner, 0]), float(self.corners[corner, 1])))
                corner = parent[corner]
            points.append(origin)
            found.append(Leg(float(length), points[::-1]))
        return found


def _corners(space: FloorSpace, radius_m: float, window: shapely.Geometry | None) -> Floats:
    """(n, 6): where the border of a grown obstacle bends and a robot can stand, each with its neighbours on the border.

    Obstacles grow one by one: uniting them would take longer than all the rest, and only
    adds corners that no shortest way turns at."""
    shapes = np.array([item.geometry for item in space.owners], object)
    # A chord spans up to one and a half sides, as their number on an arc is rounded; it must not cut into the radius.
    grown = max(radius_m, LEAST_GROWTH_M) / math.cos(1.5 * math.pi / (4 * ARC_SIDES))
    if window is not None:
        shapes = shapes[shapely.dwithin(shapes, window, grown)]
    polygons = shapely.get_parts(shapely.buffer(shapes, grown, quad_segs=ARC_SIDES))
    rings = shapely.get_rings(shapely.orient_polygons(polygons, exterior_cw=True))  # free space on the left
    at, ring = shapely.get_coordinates(rings, return_index=True)
    if not len(at):
        return np.empty((0, 6))
    first = np.flatnonzero(np.diff(ring, prepend=-1))
    last = np.append(first[1:], len(at)) - 1  # equal to the first
    before, after = np.roll(at, 1, axis=0), np.roll(at, -1, axis=0)
    before[first] = at[last - 1]
    into, out = at - before, after - at
    bends_away = into[:, 0] * out[:, 1] - into[:, 1] * out[:, 0] < -1e-12
    bends_away[last] = False
    corners = np.hstack([at, before, after])[bends_away]
    return corners[_free(space.grid, space.region, space.inside, corners, radius_m)]


@kernel
def _free(grid: Grid, region: Floats, inside: int, corners: Floats, radius: float) -> NDArray[np.bool_]:
    free = np.empty(corners.shape[0], np.bool_)
    for i in range(corners.shape[0]):
        free[i] = stands_free(grid, region, inside, corners[i, 0], corners[i, 1], radius)
    return free


@kernel
def _touches(corners: Floats, i: int, x: float, y: float) -> bool:
    """Whether the line from (x, y) to corner i leaves the obstacle there on one side: only such lines are shortest."""
    cx, cy, px, py, nx, ny = corners[i]
    before = (cx - x) * (py - y) - (cy - y) * (px - x)
    after = (cx - x) * (ny - y) - (cy - y) * (nx - x)
    slack = 1e-9 * (abs(cx - x) + abs(cy - y))
    return not ((before > slack and after < -slack) or (before < -slack and after > slack))


@kernel
def _look(
    grid: Grid, lanes: Floats, corners: Floats, x: float, y: float, own: int, outbound: bool, radius: float, row: Floats
) -> None:
    """Fill `row` with the distances between (x, y) and the corners it sees; inf for the others."""
    for j in range(corners.shape[0]):
        row[j] = np.inf
        if j == own or not _touches(corners, j, x, y):
            continue
        cx, cy = corners[j, 0], corners[j, 1]
        if own >= 0 and not _touches(corners, own, cx, cy):
            continue
        if not line_free(grid, x, y, cx, cy, radius):
            continue
        if outbound:
            wrong_way = against_one_way(lanes, x, y, cx, cy, radius)
        else:
            wrong_way = against_one_way(lanes, cx, cy, x, y, radius)
        if not wrong_way:
            row[j] = math.hypot(cx - x, cy - y)


@kernel
def _smallest(values: Floats, rank: int) -> float:
    """The value of that rank, 1 being the smallest."""
    for i in range(values.shape[0]):
        below = not_above = 0
        for k in range(values.shape[0]):
            below += values[k] < values[i]
            not_above += values[k] <= values[i]
        if below < rank <= not_above:
            return values[i]
    return np.inf


@kernel
def _spread(
    grid: Grid,
    lanes: Floats,
    corners: Floats,
    sight: Floats,
    seen: NDArray[np.bool_],
    x: float,
    y: float,
    goals: Floats,
    enough: int,
    radius: float,
) -> tuple[Floats, NDArray[np.int64], NDArray[np.int64]]:
    """A* from (x, y) to the `enough` nearest goals: length to each, the last corner before each (-1 where it is
    straight), and the parents of corners."""
    count, wanted = corners.shape[0], goals.shape[0]
    length = np.full(wanted, np.inf)
    last = np.full(wanted, -1, np.int64)
    parent = np.full(count, -1, np.int64)
    cost = np.empty(count)
    arrival = np.empty((wanted, count))
    estimate = np.full(count, np.inf)
    done = np.zeros(count, np.bool_)
    scratch = np.empty(count)
    _look(grid, lanes, corners, x, y, -1, True, radius, cost)
    for g in range(wanted):
        gx, gy = goals[g]
        if line_free(grid, x, y, gx, gy, radius) and not against_one_way(lanes, x, y, gx, gy, radius):
            length[g] = math.hypot(gx - x, gy - y)
        _look(grid, lanes, corners, gx, gy, -1, False, radius, arrival[g])
        for j in range(count):
            estimate[j] = min(estimate[j], math.hypot(corners[j, 0] - gx, corners[j, 1] - gy))
    kept = seen.shape[0] > 0
    while True:
        at, least = -1, _smallest(length, enough)
        for j in range(count):
            if not done[j] and cost[j] + estimate[j] < least:
                at, least = j, cost[j] + estimate[j]
        if at < 0:
            return length, last, parent
        done[at] = True
        for g in range(wanted):
            if cost[at] + arrival[g, at] < length[g]:
                length[g], last[g] = cost[at] + arrival[g, at], at
        if kept and seen[at]:
            row = sight[at]
        else:
            row = scratch
            _look(grid, lanes, corners, corners[at, 0], corners[at, 1], at, True, radius, row)
            if kept:  # two threads may find the same row at once: both write the same values
                sight[at] = row
                seen[at] = True
        for j in range(count):
            if not done[j] and cost[at] + row[j] < cost[j]:
                cost[j] = cost[at] + row[j]
                parent[j] = at
