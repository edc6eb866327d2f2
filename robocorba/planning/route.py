"""Routes as arrays, and the points of the path that a route gives.

A route is an array (k, COLUMNS) with one row for each stop: index of the floor, x and y [m], index of the path node
or -1, and the step to the next stop: index of the elevator or -1 for a drive, speed limit [m/s] (inf for none),
seconds to wait for the elevator and to travel in it, and what the drive follows: OFF_ROAD, a path edge (ON_ROAD), or
one that it must follow, because it is one-way or has a speed limit (ON_FIXED_ROAD). A route begins and ends with a
drive.
"""

from __future__ import annotations

import math

import numpy as np

from robocorba.map_editor.spatial.arrays import Floats
from robocorba.planning.request import PointKind
from robocorba.system.kernels import kernel

FLOOR, X, Y, NODE, ELEVATOR, LIMIT, WAITS, TRAVELS, ROAD = range(9)
COLUMNS = 9
OFF_ROAD, ON_ROAD, ON_FIXED_ROAD = range(3)


def waypoints(floor: float, places: Floats) -> Floats:
    """Rows (k, COLUMNS) of drives between points (k, 2) [m] of a floor, off the topological map."""
    rows = np.empty((len(places), COLUMNS))
    rows[:] = (floor, 0.0, 0.0, -1.0, -1.0, math.inf, 0.0, 0.0, 0.0)
    rows[:, X : Y + 1] = places
    return rows


def off_road(route: Floats) -> Floats:
    """The same drives without nodes and speed limits, except the nodes in cabins."""
    rows = route.copy()
    rides = rows[:, ELEVATOR] >= 0.0
    rows[~(rides | np.roll(rides, 1)), NODE] = -1.0
    rows[:, LIMIT], rows[:, ROAD] = math.inf, OFF_ROAD
    return rows


@kernel
def measure(route: Floats, elevations: Floats, speed: float) -> Floats:
    """The points (k, 9) of a route driven at `speed` [m/s], with the columns of request.Path; `elevations` are those
    of the floors [m]. The wait for an elevator is a part of the time between its entry and its exit."""
    count = route.shape[0]
    points = np.empty((count, 9))
    distance = time = heading = 0.0
    ridden = -1.0
    for i in range(count):
        step, goes_by = 0.0, route[i, ELEVATOR]
        if goes_by < 0.0 and i < count - 1:
            dx, dy = route[i + 1, X] - route[i, X], route[i + 1, Y] - route[i, Y]
            step = math.hypot(dx, dy)
            if step > 0.0:
                heading = math.atan2(dy, dx)
        kind = PointKind.NODE if route[i, NODE] >= 0.0 else PointKind.WAYPOINT
        if i == 0:
            kind = PointKind.START
        elif i == count - 1:
            kind = PointKind.GOAL
        elif goes_by >= 0.0:
            kind = PointKind.ELEVATOR_ENTRY
        elif ridden >= 0.0:
            kind = PointKind.ELEVATOR_EXIT
        points[i, 0], points[i, 1], points[i, 2] = kind.value, route[i, NODE], route[i, FLOOR]
        points[i, 3], points[i, 4], points[i, 5] = route[i, X], route[i, Y], heading
        points[i, 6], points[i, 7], points[i, 8] = distance, time, max(goes_by, ridden)
        if goes_by >= 0.0:
            distance += abs(elevations[int(route[i + 1, FLOOR])] - elevations[int(route[i, FLOOR])])
            time += route[i, WAITS] + route[i, TRAVELS]  # so that times before it are of drives only
        else:
            distance += step
            time += step / min(speed, route[i, LIMIT])
        ridden = goes_by
    return points
