"""Checks a path with shapely, independently of the planner."""

from __future__ import annotations

import math
from itertools import pairwise

import shapely
from shapely import LineString, Polygon

from robocorba.maps.geometry import obstacles
from robocorba.maps.model import Building
from robocorba.planning.request import Path, PointKind

#: Tolerance for rounding [m].
FORGIVEN_M = 1e-6


def faults(building: Building, path: Path, radius_m: float) -> list[str]:
    """The errors of a path for a robot of this radius [m], one sentence each; empty if there are none.

    Checked: distance to walls, objects, shafts and outline; rides only in elevators that serve both floors; floors
    changed only by rides; distance and time never decrease."""
    found = []
    points = path.points
    if not points or points[0].kind is not PointKind.START or points[-1].kind is not PointKind.GOAL:
        found.append("the path does not lead from a start to a goal")
    for a, b in pairwise(points):
        where = f"from {a.floor}:{a.x:.2f},{a.y:.2f} to {b.floor}:{b.x:.2f},{b.y:.2f}"
        if a.kind is PointKind.ELEVATOR_ENTRY:
            if b.kind is not PointKind.ELEVATOR_EXIT or a.elevator != b.elevator:
                found.append(f"{where}: a ride without an end")
            elif not {a.floor, b.floor} <= set(building.elevators[a.elevator].floors()):
                found.append(f"{where}: elevator {a.elevator} does not serve both floors")
        elif a.floor != b.floor:
            found.append(f"{where}: changes the floor without an elevator")
        else:
            found += [f"{where}: {reason}" for reason in _touched(building, a.floor, (a.x, a.y), (b.x, b.y), radius_m)]
        if b.distance < a.distance or b.time < a.time or not math.isfinite(b.distance + b.time):
            found.append(f"{where}: distance or time falls")
    return found


def _touched(
    building: Building, floor: str, a: tuple[float, float], b: tuple[float, float], radius_m: float
) -> list[str]:
    line = LineString([a, b]) if a != b else shapely.Point(a)
    found = [
        f"{line.distance(item.geometry):.3f} m to {item.kind} {item.name}, {radius_m:.3f} m needed"
        for item in obstacles(building, floor)
        if line.distance(item.geometry) < radius_m - FORGIVEN_M
    ]
    outline = building.floors[floor].floor.outline
    if outline and not Polygon(outline).covers(line):
        found.append("leaves the outline")
    return found
