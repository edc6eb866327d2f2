"""Why an object can't be carried somewhere: the door, the elevator or the turn that blocks.

The object alone, taken for a disc, shows the way. The first place on it that the whole body did not reach is where it
got stuck.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.errors.paths import Blocker
from robocorba.errors.robots import ImpossibleCarry
from robocorba.maps.geometry import landing_line
from robocorba.maps.model import Elevator
from robocorba.missions.formation import Formation, Pose, width_of
from robocorba.missions.surroundings import Ground, Nearest, Surroundings, placed
from robocorba.planning.body_search import HEADINGS, Bytes, Lattice, remaining
from robocorba.spatial.grids import Floats
from robocorba.spatial.pose import XY

#: A disc of this radius shows whether the walls leave any way at all, m.
THIN_M = 0.05
#: Obstacles are named that are so near to the body, m.
NEAR_M = 5.0


class Searched(NamedTuple):
    """left: what `remaining` says for a disc of `core_m`; reached: points that the body was at; start: of a way that
    was looked for."""

    lattice: Lattice
    left: Floats
    core_m: float
    reached: Bytes
    start: XY
    goals: Floats


class Attempt(NamedTuple):
    """One leg of a way that a formation did not find. leg: number of rides before it; cabin: where the leg ends, None
    at the goal; searched: None where the cabin has no room for the body."""

    leg: int
    formation: Formation
    footprint: BaseGeometry
    ground: Ground
    cabin: Elevator | None
    searched: Searched | None


def why_not_free(which: str, floor: str, pose: Pose, part: str, near: Nearest, margin_m: float) -> ImpossibleCarry:
    """At the start or at the goal; part: of the body, which something is too near to."""
    needed = f"{near.distance_m:.2f} m from {part}, {margin_m:.2f} m needed" if near.distance_m else f"is in {part}"
    return ImpossibleCarry(
        f"{which} {floor}:{pose[0]:g},{pose[1]:g} is not free for {part}", [_blocker(near, floor, needed)]
    )


def why_impossible(
    surroundings: Surroundings, outline: Polygon, attempts: Sequence[Attempt], margin_m: float
) -> ImpossibleCarry:
    """Of the attempts that got farthest."""
    farthest = max(attempt.leg for attempt in attempts)
    last = [attempt for attempt in attempts if attempt.leg == farthest]
    searched = [attempt for attempt in last if attempt.searched]
    if not searched:
        return ImpossibleCarry("no elevator has room for it", _small_cabins(last, margin_m))
    stuck = [(_progress(attempt), attempt) for attempt in searched]
    ways = [(share, way, at, attempt) for (share, way, at), attempt in stuck if way]
    if not ways:
        return ImpossibleCarry("start and goal are not connected", _closed(searched[0].ground, surroundings))
    _, way, at, attempt = max(ways, key=lambda item: item[0])
    needed = min(width_of(each.footprint) for each in searched) + 2 * margin_m
    blocker = _narrow_door(surroundings, attempt, way, at, needed) or _turn(attempt, way[at], margin_m)
    count = len(attempt.formation.grips)
    return ImpossibleCarry(
        f"{count} {'robot' if count == 1 else 'robots'} can't carry it through {attempt.ground.floor}", [blocker]
    )


def _blocker(near: Nearest, floor: str, reason: str) -> Blocker:
    kind, name = near.item.kind, near.item.name
    return Blocker(kind, "" if kind in ("elevator", "floor") else floor, name, reason)


def _small_cabins(attempts: Sequence[Attempt], margin_m: float) -> list[Blocker]:
    sizes = []
    for attempt in attempts:
        corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(attempt.footprint))
        sides = sorted(math.dist(a, b) + 2 * margin_m for a, b in pairwise(corners[:3].tolist()))
        sizes.append((sides[0] * sides[1], sides))
    _, (short, long) = min(sizes)
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


def _progress(attempt: Attempt) -> tuple[float, list[XY], int]:
    """Share of the way that was reached, the way of a disc and the index of the first point of it that was not; no way
    where even a thin disc finds none."""
    assert attempt.searched
    lattice, left, core_m, reached, start, goals = attempt.searched
    way = _downhill(lattice, left, start) or _downhill(lattice, remaining(lattice, goals, THIN_M), start)
    if not way:
        return 0.0, [], 0
    if reached.any():
        been = np.array([_was_near(lattice, reached, point) for point in way])
        at = min(int(np.flatnonzero(been).max(initial=-1)) + 1, len(way) - 1)
    else:  # the object alone is too wide
        at = next((i for i, point in enumerate(way) if _open_at(lattice, point) < core_m), 0)
    return at / len(way), way, at


def _downhill(lattice: Lattice, left: Floats, start: XY) -> list[XY]:
    """From a place to where nothing is left; empty where no way begins there."""
    x0, y0, _, step, columns, rows, _ = lattice.frame.tolist()
    column, row = round((start[0] - x0) / step), round((start[1] - y0) / step)

    def around(column: int, row: int) -> list[tuple[float, int, int]]:
        return [
            (float(left[r, c]), c, r)
            for r in range(max(row - 1, 0), min(row + 2, int(rows)))
            for c in range(max(column - 1, 0), min(column + 2, int(columns)))
        ]

    way: list[XY] = []
    here = math.inf
    while here > 0.0:
        lower, column, row = min(around(column, row), default=(math.inf, 0, 0))
        if not lower < here:
            return []
        here = lower
        way.append((x0 + column * step, y0 + row * step))
    return way


def _open_at(lattice: Lattice, point: XY) -> float:
    x0, y0, _, step, _, _, _ = lattice.frame.tolist()
    return float(lattice.open_m[round((point[1] - y0) / step), round((point[0] - x0) / step)])


def _was_near(lattice: Lattice, reached: Bytes, point: XY) -> bool:
    x0, y0, _, step, _, _, _ = lattice.frame.tolist()
    column, row = round((point[0] - x0) / step), round((point[1] - y0) / step)
    return bool(reached[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2].any())


def _closed(ground: Ground, surroundings: Surroundings) -> list[Blocker]:
    doors = surroundings.building.floors[ground.floor].geometrical.doors.values()
    locked = [Blocker("door", ground.floor, door.name, "is locked") for door in doors if door.locked]
    return locked or [Blocker("floor", "", ground.floor, "what stands there closes the place off")]


def _narrow_door(
    surroundings: Surroundings, attempt: Attempt, way: Sequence[XY], at: int, needed_m: float
) -> Blocker | None:
    """The narrow door that the body came to before it got stuck, if there is one."""
    floor = attempt.ground.floor
    entry = surroundings.building.floors[floor]
    doors = [
        (LineString([door.a, door.b]), Blocker("door", floor, door.name, ""))
        for door in entry.geometrical.doors.values()
        if not door.locked
    ]
    for elevator in surroundings.building.elevators.values():
        for door in elevator.doors:
            if door.floor == floor:
                doors.append((landing_line(elevator, door), Blocker("elevator", "", elevator.name, "its door ")))
    reach = float(np.hypot(*shapely.get_coordinates(attempt.footprint).T).max()) + THIN_M
    here = shapely.Point(way[at])
    found = []
    if len(way) < 2:
        return None
    for line, blocker in doors:
        if line.length < needed_m and line.distance(here) <= reach and line.intersects(LineString(way)):
            reason = f"{blocker.reason}is {line.length:.2f} m wide, {needed_m:.2f} m needed"
            found.append((line.distance(here), Blocker(blocker.kind, blocker.floor, blocker.name, reason)))
    return min(found, key=lambda item: item[0])[1] if found else None


def _turn(attempt: Attempt, at: XY, margin_m: float) -> Blocker:
    """What is in the way of the body at a place, whichever way it is turned there."""
    floor = attempt.ground.floor
    nearest = []
    for layer in range(HEADINGS):
        pose = (*at, math.tau * layer / HEADINGS)
        near = attempt.ground.nearest(placed(attempt.footprint, pose), NEAR_M)
        if near:
            nearest.append(near)
    if not nearest:
        return Blocker("floor", "", floor, f"no way was found from ({at[0]:.1f}, {at[1]:.1f}) on")
    best = max(nearest, key=lambda near: near.distance_m)
    what = "to turn" if best.distance_m >= margin_m else "for it"
    return _blocker(best, floor, f"leaves no room {what} at {floor} ({at[0]:.1f}, {at[1]:.1f})")
