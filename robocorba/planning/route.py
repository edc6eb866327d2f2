"""A way, row by row, and what it amounts to as a path.

A way is an array (k, COLUMNS), a row a stop: the index of its floor, x and y in m, the
index of its node or -1, and how it goes on from there: the index of the elevator ridden
or -1 for a drive, the speed limit in m/s (inf for none), the seconds to wait for the
elevator and to travel in it, and 1 where the drive must be made as drawn (a one-way edge, or
one with a speed limit), else 0. It begins and ends with a drive.
"""

from __future__ import annotations

import math

import numpy as np

from robocorba.kernels import kernel
from robocorba.planning.request import PointKind
from robocorba.spatial.grids import Floats

FLOOR, X, Y, NODE, ELEVATOR, LIMIT, WAITS, TRAVELS, FIXED = range(9)
COLUMNS = 9

_START, _NODE, _WAYPOINT, _ENTRY, _EXIT, _GOAL = (float(kind.value) for kind in PointKind)


def waypoints(floor: float, places: Floats) -> Floats:
    """The rows of drives over places (k, 2) of a floor, off the graph."""
    rows = np.empty((len(places), COLUMNS))
    rows[:] = (floor, 0.0, 0.0, -1.0, -1.0, math.inf, 0.0, 0.0, 0.0)
    rows[:, X : Y + 1] = places
    return rows


@kernel
def measure(way: Floats, elevations: Floats, speed: float) -> Floats:
    """The points of a way driven at `speed` m/s, a row each as in request.Path; `elevations` of the floors in m."""
    count = way.shape[0]
    points = np.empty((count, 9))
    distance = time = heading = 0.0
    ridden = -1.0
    for i in range(count):
        step, goes_by = 0.0, way[i, ELEVATOR]
        if goes_by >= 0.0:
            time += way[i, WAITS]
        elif i < count - 1:
            dx, dy = way[i + 1, X] - way[i, X], way[i + 1, Y] - way[i, Y]
            step = math.hypot(dx, dy)
            if step > 0.0:
                heading = math.atan2(dy, dx)
        kind = _NODE if way[i, NODE] >= 0.0 else _WAYPOINT
        if i == 0:
            kind = _START
        elif i == count - 1:
            kind = _GOAL
        elif goes_by >= 0.0:
            kind = _ENTRY
        elif ridden >= 0.0:
            kind = _EXIT
        points[i, 0], points[i, 1], points[i, 2] = kind, way[i, NODE], way[i, FLOOR]
        points[i, 3], points[i, 4], points[i, 5] = way[i, X], way[i, Y], heading
        points[i, 6], points[i, 7], points[i, 8] = distance, time, max(goes_by, ridden)
        if goes_by >= 0.0:
            distance += abs(elevations[int(way[i + 1, FLOOR])] - elevations[int(way[i, FLOOR])])
            time += way[i, TRAVELS]
        else:
            distance += step
            time += step / min(speed, way[i, LIMIT])
        ridden = goes_by
    return points
