"""Buildings in which robots carry something to and fro, and the robots' start poses."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from robocorba.map_editor.model import BoxShape, Building, CabinSide, Door, Elevator, ElevatorDoor, MapObject, Wall
from robocorba.simulation.registry import Pose
from testkit.buildings import rectangular, two_storeys
from testkit.missions import FLOOR, RobotStart, three_rooms

UPPER = "L2"
CHAIR = "chair"


class Site(NamedTuple):
    """item: what is carried between `goals`. starts: of robots, far from its way, in both sub-networks in turns."""

    building: Building
    item: str
    goals: tuple[Pose, Pose]
    starts: tuple[RobotStart, ...]


def _starts(
    *places: tuple[float, float, float], upper: tuple[tuple[float, float, float], ...] = ()
) -> tuple[RobotStart, ...]:
    everywhere = [*((place, FLOOR) for place in places), *((place, UPPER) for place in upper)]
    return tuple(
        RobotStart(*place, ("lab", "hall")[number % 2], floor=floor) for number, (place, floor) in enumerate(everywhere)
    )


def rooms() -> Site:
    places = (0.5, 0.5, 0.0), (9.4, 2.6, math.pi), (5.4, 4.5, math.pi), (8.5, 1.0, math.pi), (8.5, 4.0, math.pi)
    return Site(three_rooms(), "table", (Pose(FLOOR, 2.2, 2.6, 0.0), Pose(FLOOR, 3.8, 2.6, 0.0)), _starts(*places))


def door() -> Site:
    """Two halls of 7 m by 7 m with a door of 2 m between them, and a box for two robots."""
    halls = rectangular(
        *("two halls", (14.0, 7.0), [FLOOR]),
        (FLOOR, MapObject("box", BoxShape((0.6, 0.4)), (3.5, 3.5), height=0.8, movable=True)),
        (FLOOR, Wall("wall", (7.0, 0.0), (7.0, 7.0))),
        (FLOOR, Door("door", (7.0, 2.5), (7.0, 4.5))),
    )
    places = (0.6, 0.6, 0.0), (0.6, 6.4, 0.0), (13.4, 0.6, math.pi), (13.4, 6.4, math.pi)
    return Site(halls, "box", (Pose(FLOOR, 3.5, 3.5, 0.0), Pose(FLOOR, 10.5, 3.5, 0.0)), _starts(*places))


def elevator() -> Site:
    corners = (0.6, 0.6, 0.0), (0.6, 6.4, 0.0)
    goals = Pose(FLOOR, 5.4, 3.5, -0.785), Pose(UPPER, 5.4, 3.5, -0.785)
    return Site(two_storeys(), "box", goals, _starts(*corners, upper=corners))


def storehouse() -> Site:
    """Two storeys with a wide elevator, and a crate of 10.8 kg: with each kill of one of its three carriers, too few
    are left to hold it."""
    doors = tuple(ElevatorDoor(floor, CabinSide.FRONT, 3.6) for floor in (FLOOR, UPPER))
    building = rectangular(
        *("storehouse", (13.0, 8.0), [FLOOR, UPPER]),
        (FLOOR, MapObject("crate", BoxShape((1.2, 1.0)), (4.8, 4.0), 0.3, height=0.8, movable=True)),
        ("", Elevator("lift", (11.0, 4.0), (4.0, 4.0), doors, heading=-math.pi / 2, speed=1.0, door_time=2.0)),
    )
    places = (0.6, 0.6, 0.0), (0.6, 7.4, 0.0), (0.6, 4.0, 0.0), (4.8, 7.4, -1.57)
    goals = Pose(FLOOR, 4.8, 4.0, 0.3), Pose(UPPER, 4.8, 4.0, 0.3)
    return Site(building, "crate", goals, _starts(*places, upper=((0.6, 0.6, 0.0),)))


def hall() -> Site:
    """A hall with a table for three of four robots. The last one is so far away that it does not carry: it and a chair
    can be put in their way."""
    goals = Pose(FLOOR, 3.5, 4.5, 0.0), Pose(FLOOR, 11.5, 4.5, 0.0)
    building = rectangular(
        *("hall", (15.0, 9.0), [FLOOR]),
        (FLOOR, MapObject("table", BoxShape((1.2, 0.8)), goals[0][1:3], height=0.7, movable=True)),
        (FLOOR, MapObject(CHAIR, BoxShape((0.5, 0.5)), (14.2, 0.8), height=0.9, movable=True)),
    )
    places = (1.0, 1.0, 0.0), (5.0, 1.0, math.pi), (1.0, 8.0, 0.0), (14.2, 8.2, math.pi)
    return Site(building, "table", goals, _starts(*places))


#: The sites by name, and what makes them.
SITES: dict[str, Callable[[], Site]] = {site.__name__: site for site in (rooms, door, elevator, storehouse, hall)}
