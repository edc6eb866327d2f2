"""What stands in the way of a robot just now and is not on the map: other robots, and objects that were moved."""

from __future__ import annotations

import math

from robocorba.data_pool.snapshot import Snapshot
from robocorba.maps.model import XY

#: Whoever is slower stands, m/s; nobody farther away matters, m.
STANDS_M_S, NEAR_M = 0.05, 15.0
#: So many are told at most; a robot is a polygon of so many corners.
MOST_ROBOTS, MOST_OBJECTS, CORNERS = 20, 30, 8
Area = tuple[str, tuple[XY, ...]]


def standing(seen: Snapshot, robot: str) -> list[Area]:
    """On the floor of `robot`, polygons by floor, m; without itself."""
    own = seen.robot(robot)
    if own is None:
        return []
    others = [near.robot for near in seen.robots_near(own.x, own.y, NEAR_M)]
    discs = [_disc(one.x, one.y, one.radius_m) for one in others if math.hypot(one.vx, one.vy) < STANDS_M_S]
    objects = [thing.corners for thing in seen.objects() if thing.is_movable]
    return [(seen.floor, area) for area in [*discs[:MOST_ROBOTS], *objects[:MOST_OBJECTS]]]


def _disc(x: float, y: float, radius_m: float) -> tuple[XY, ...]:
    turns = [math.tau * corner / CORNERS for corner in range(CORNERS)]
    return tuple((x + radius_m * math.cos(turn), y + radius_m * math.sin(turn)) for turn in turns)
