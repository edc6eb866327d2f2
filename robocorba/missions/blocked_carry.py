"""Why a carry is impossible: the door, the elevator or the turn that blocks it.

The path of a disc within the object is the reference. The body got stuck at the first point of it that the search did
not reach.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from shapely import LineString
from shapely.geometry.base import BaseGeometry

from robocorba.errors.paths import Blocker
from robocorba.errors.places import place
from robocorba.errors.robots import ImpossibleCarry
from robocorba.map_editor.geometry import Obstacle, landing_line
from robocorba.map_editor.model import Elevator
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.pose import XY, Pose
from robocorba.missions.formation import MARGIN_M, Formation, width_of
from robocorba.missions.obstacles import BuildingObstacles, FloorObstacles, placed
from robocorba.planning.body_search import HEADINGS, Bytes, Lattice, distances_to_goal

#: Radius of the disc that shows whether start and goal are connected at all [m].
THIN_RADIUS_M = 0.05


class FailedSearch(NamedTuple):
    """A search without a route. to_goal_m: distance from each lattice point to a goal for a disc of radius `core_m`.
    reached: lattice points that the body reached."""

    lattice: Lattice
    to_goal_m: Floats
    core_m: float
    reached: Bytes
    start: XY
    goals: Floats


class FailedLeg(NamedTuple):
    """A leg for which a formation has no path. leg: number of rides before it. cabin: at the end of the leg, None at
    the goal. search: None if the body does not fit into the cabin."""

    leg: int
    formation: Formation
    footprint: BaseGeometry
    obstacles: FloorObstacles
    cabin: Elevator | None
    search: FailedSearch | None


def why_not_free(which: str, pose: Pose, part: str, near: tuple[Obstacle, float], margin_m: float) -> ImpossibleCarry:
    """The error for an obstacle too near to a part of the body at `which`: the start or the goal. near: with its
    distance."""
    item, distance_m = near
    needed = f"{distance_m:.2f} m from {part}, {margin_m:.2f} m needed" if distance_m else f"is in {part}"
    return ImpossibleCarry(
        f"{which} {place(pose.floor, pose.x, pose.y)} is not free for {part}", [_blocker(item, pose.floor, needed)]
    )


def why_impossible(building_obstacles: BuildingObstacles, attempts: Sequence[FailedLeg]) -> ImpossibleCarry:
    """The error for the attempts that got farthest."""
    farthest = max(attempt.leg for attempt in attempts)
    last = [attempt for attempt in attempts if attempt.leg == farthest]
    searched = [(attempt, attempt.search) for attempt in last if attempt.search]
    if not searched:
        return ImpossibleCarry("it does not fit into any elevator", _small_cabins(last))
    progress = [(*_progress(search), attempt) for attempt, search in searched]
    paths = [(share, path, at, attempt) for share, path, at, attempt in progress if path]
    if not paths:
        return ImpossibleCarry(
            "start and goal are not connected", _barriers(searched[0][0].obstacles, building_obstacles)
        )
    _, path, at, attempt = max(paths, key=lambda item: item[0])
    needed_m = min(width_of(each.footprint) for each, _ in searched) + 2 * MARGIN_M
    blocker = _narrow_door(building_obstacles, attempt, path, at, needed_m) or _tight_spot(attempt, path[at])
    count = len(attempt.formation.grips)
    return ImpossibleCarry(
        f"{count} {'robot' if count == 1 else 'robots'} can't carry it through {attempt.obstacles.floor}", [blocker]
    )


def _blocker(item: Obstacle, floor: str, reason: str) -> Blocker:
    return Blocker(item.kind, "" if item.kind in ("elevator", "floor") else floor, item.name, reason)


def _small_cabins(attempts: Sequence[FailedLeg]) -> list[Blocker]:
    sizes = []
    for attempt in attempts:
        corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(attempt.footprint))
        sizes.append(sorted(math.dist(a, b) + 2 * MARGIN_M for a, b in pairwise(corners[:3].tolist())))
    short, long = min(sizes, key=math.prod)
    cabins = {attempt.cabin.name: attempt.cabin for attempt in attempts if attempt.cabin}
    return [
        Blocker(
            "elevator",
            "",
            name,
            f"its cabin is {cabin.size[0]:.2f} m by {cabin.size[1]:.2f} m, {long:.2f} m by {short:.2f} m needed",
        )
        for name, cabin in cabins.items()
    ]


def _progress(search: FailedSearch) -> tuple[float, list[XY], int]:
    """Share of a disc's path that the body reached, the path, and the index of its first point not reached; an empty
    path if even a thin disc has none."""
    lattice, to_goal_m, core_m, reached, start, goals = search
    path = _downhill(lattice, to_goal_m, start) or _downhill(
        lattice, distances_to_goal(lattice, goals, THIN_RADIUS_M), start
    )
    if not path:
        return 0.0, [], 0
    if reached.any():
        last = max((i for i, point in enumerate(path) if _was_near(lattice, reached, point)), default=-1)
        at = min(last + 1, len(path) - 1)
    else:  # the object alone is too wide
        at = next((i for i, point in enumerate(path) if lattice.open_m[_cell(lattice, point)] < core_m), 0)
    return at / len(path), path, at


def _cell(lattice: Lattice, point: XY) -> tuple[int, int]:
    """Row and column of the lattice point nearest to a point."""
    return round((point[1] - lattice.y) / lattice.step), round((point[0] - lattice.x) / lattice.step)


def _downhill(lattice: Lattice, to_goal_m: Floats, start: XY) -> list[XY]:
    """The path from a point to where `to_goal_m` is 0; empty if there is none."""
    rows, columns = lattice.open_m.shape
    row, column = _cell(lattice, start)
    path: list[XY] = []
    here_m = math.inf
    while here_m > 0.0:
        around = (
            (float(to_goal_m[r, c]), c, r)
            for r in range(max(row - 1, 0), min(row + 2, rows))
            for c in range(max(column - 1, 0), min(column + 2, columns))
        )
        lower_m, column, row = min(around, default=(math.inf, 0, 0))
        if not lower_m < here_m:
            return []
        here_m = lower_m
        path.append((lattice.x + column * lattice.step, lattice.y + row * lattice.step))
    return path


def _was_near(lattice: Lattice, reached: Bytes, point: XY) -> bool:
    row, column = _cell(lattice, point)
    return bool(reached[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].any())


def _barriers(obstacles: FloorObstacles, building_obstacles: BuildingObstacles) -> list[Blocker]:
    doors = building_obstacles.building.floors[obstacles.floor].geometrical.doors.values()
    locked = [Blocker("door", obstacles.floor, door.name, "is locked") for door in doors if door.locked]
    return locked or [Blocker("floor", "", obstacles.floor, "obstacles separate start and goal")]


def _narrow_door(
    building_obstacles: BuildingObstacles, attempt: FailedLeg, path: Sequence[XY], at: int, needed_m: float
) -> Blocker | None:
    """The narrow door where the body got stuck, None if it is not at a door."""
    floor = attempt.obstacles.floor
    entry = building_obstacles.building.floors[floor]
    doors = [
        (LineString([door.a, door.b]), Blocker("door", floor, door.name, ""))
        for door in entry.geometrical.doors.values()
        if not door.locked
    ]
    for elevator in building_obstacles.building.elevators.values():
        for door in elevator.doors:
            if door.floor == floor:
                doors.append((landing_line(elevator, door), Blocker("elevator", "", elevator.name, "its door ")))
    if len(path) < 2:
        return None
    reach_m = float(np.hypot(*shapely.get_coordinates(attempt.footprint).T).max()) + THIN_RADIUS_M
    here = shapely.Point(path[at])
    found = []
    for line, blocker in doors:
        if line.length < needed_m and line.distance(here) <= reach_m and line.intersects(LineString(path)):
            reason = f"{blocker.reason}is {line.length:.2f} m wide, {needed_m:.2f} m needed"
            found.append((line.distance(here), Blocker(blocker.kind, blocker.floor, blocker.name, reason)))
    return min(found, key=lambda item: item[0])[1] if found else None


def _tight_spot(attempt: FailedLeg, at: XY) -> Blocker:
    """The obstacle that blocks the body at a point, at the heading with the largest clearance."""
    floor = attempt.obstacles.floor
    poses = [(*at, math.tau * heading_index / HEADINGS) for heading_index in range(HEADINGS)]
    near_m = 5.0  # obstacles beyond this are not named
    nearest = [attempt.obstacles.nearest(placed(attempt.footprint, pose), near_m) for pose in poses]
    best = max(filter(None, nearest), key=lambda near: near[1], default=None)
    if not best:
        return Blocker("floor", "", floor, f"no path found beyond ({at[0]:.1f}, {at[1]:.1f})")
    item, distance_m = best
    what = "to turn" if distance_m >= MARGIN_M else "for it"
    return _blocker(item, floor, f"leaves no room {what} at {floor} ({at[0]:.1f}, {at[1]:.1f})")
