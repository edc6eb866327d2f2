"""What stands in the way of a robot just now and is not on the map: other robots, and objects that were moved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from robocorba.data_pool.snapshot import Snapshot
from robocorba.data_pool.things import Thing
from robocorba.maps.polygons import FloorArea
from robocorba.spatial.pose import XY

#: Whoever is slower stands, m/s; nobody farther away matters, m.
STANDS_M_S, NEAR_M = 0.05, 15.0
#: Paths keep so far from robots that stand, m; less where the robot itself is nearer already. A place beside a robot is
#: so far outside, m, that the way there may keep some room to everything else.
ROOM_M, LEAST_M = 0.1, 0.07
#: So many are told at most; a robot is a polygon of so many corners.
MOST_ROBOTS, MOST_OBJECTS, CORNERS = 20, 30, 16


class Standing(NamedTuple):
    """For a PathRequest: polygons of floors, m, and floors whose movable objects are all among them."""

    forbidden_areas: tuple[FloorArea, ...] = ()
    without_movables: tuple[str, ...] = ()


def objects(seen: Snapshot, robot: str, held: str = "") -> Standing:
    """On the floor of `robot`, only what can be moved, where it is now; without what the robot holds itself."""
    own = seen.robot(robot)
    if own is None:
        return Standing()
    movable = (thing for thing in seen.objects() if thing.is_movable and thing.name != held)
    things = sorted(movable, key=lambda thing: _apart(thing, own))
    knows_all = len(things) <= MOST_OBJECTS
    areas = tuple((seen.floor, thing.corners) for thing in things[:MOST_OBJECTS])
    return Standing(areas, (seen.floor,) if knows_all else ())


def standing(seen: Snapshot, robot: str, also: str = "", goal: XY | None = None, held: str = "") -> Standing:
    """The same, and other robots that stand. also: a robot that counts even if it moves. goal: where it may come
    nearer to others than on its way."""
    own = seen.robot(robot)
    if own is None:
        return Standing()
    near = [one.robot for one in seen.robots_near(own.x, own.y, NEAR_M)]
    kept = [(own.x, own.y), *([goal] if goal else ())]
    discs = [
        _disc(one, kept, own.radius_m) for one in near if one.name == also or math.hypot(one.vx, one.vy) < STANDS_M_S
    ]
    known = objects(seen, robot, held)
    robots = tuple((seen.floor, disc) for disc in discs[:MOST_ROBOTS])
    return known._replace(forbidden_areas=robots + known.forbidden_areas)


def _disc(one: Thing, kept: Sequence[XY], radius_m: float) -> tuple[XY, ...]:
    """Around a robot, with some room; but another one of that radius stands outside at these places, if it can."""
    nearest_m = min(math.dist((one.x, one.y), place) for place in kept)
    corner_m = (one.radius_m + ROOM_M) / math.cos(math.pi / CORNERS)
    corner_m = max(min(corner_m, nearest_m - radius_m - LEAST_M), one.radius_m / 2)
    turns = [math.tau * corner / CORNERS for corner in range(CORNERS)]
    return tuple((one.x + corner_m * math.cos(turn), one.y + corner_m * math.sin(turn)) for turn in turns)


def _apart(one: Thing, own: Thing) -> float:
    return math.hypot(one.x - own.x, one.y - own.y)
