"""Buildings in which robots carry something to and fro, for benches that kill while they do."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from robocorba.map_editor.model import BoxShape, Building, CabinSide, Door, Elevator, ElevatorDoor, MapObject, Wall
from robocorba.simulation.registry import Pose
from testkit.buildings import rectangular, two_storeys
from testkit.missions import FLOOR, RobotStart, three_rooms

UPPER = "L2"


class Site(NamedTuple):
    """item: what is carried between `goals`. starts: of robots; more than carry it, and far from its way."""

    building: Callable[[], Building]
    item: str
    goals: tuple[Pose, Pose]
    starts: tuple[RobotStart, ...]


def two_halls() -> Building:
    """Two halls of 7 m by 7 m with a door of 2 m between them, and a box for two robots."""
    return rectangular(
        "two halls",
        (14.0, 7.0),
        [FLOOR],
        (FLOOR, MapObject("box", BoxShape((0.6, 0.4)), (3.5, 3.5), height=0.8, movable=True)),
        (FLOOR, Wall("wall", (7.0, 0.0), (7.0, 7.0))),
        (FLOOR, Door("door", (7.0, 2.5), (7.0, 4.5))),
    )


def workshop() -> Building:
    """A workshop with a gate to a yard with a goods lift, and a store upstairs: a building that nothing is tuned to."""
    doors = tuple(ElevatorDoor(floor, CabinSide.FRONT, 2.6) for floor in (FLOOR, UPPER))
    return rectangular(
        "workshop",
        (14.2, 8.6),
        [FLOOR, UPPER],
        (FLOOR, MapObject("crate", BoxShape((0.8, 0.5)), (2.6, 6.4), 0.5, height=0.7, movable=True)),
        (FLOOR, MapObject("shelf", BoxShape((1.4, 0.6)), (4.9, 0.5))),
        (FLOOR, MapObject("workbench", BoxShape((0.7, 2.0)), (0.5, 2.2))),
        (FLOOR, MapObject("column", BoxShape((0.4, 0.4)), (10.3, 6.3), 0.3)),
        (FLOOR, Wall("wall", (6.2, 0.0), (6.2, 8.6))),
        (FLOOR, Door("gate", (6.2, 4.6), (6.2, 7.0))),
        (UPPER, MapObject("rack", BoxShape((2.2, 0.6)), (3.4, 1.0), 0.2)),
        ("", Elevator("goods lift", (12.0, 2.4), (3.2, 3.2), doors, heading=math.pi, speed=1.0, door_time=2.0)),
    )


def storehouse() -> Building:
    """Two storeys with a wide elevator, and a crate of 10.8 kg: with each kill of one of its three carriers, too few
    are left to hold it."""
    doors = tuple(ElevatorDoor(floor, CabinSide.FRONT, 3.6) for floor in (FLOOR, UPPER))
    return rectangular(
        "storehouse",
        (13.0, 8.0),
        [FLOOR, UPPER],
        (FLOOR, MapObject("crate", BoxShape((1.2, 1.0)), (4.8, 4.0), 0.3, height=0.8, movable=True)),
        ("", Elevator("lift", (11.0, 4.0), (4.0, 4.0), doors, heading=-math.pi / 2, speed=1.0, door_time=2.0)),
    )


SITES = {
    "rooms": Site(
        three_rooms,
        "table",
        (Pose(FLOOR, 2.2, 2.6, 0.0), Pose(FLOOR, 3.8, 2.6, 0.0)),
        (
            RobotStart(0.5, 0.5, 0.0, "lab"),
            RobotStart(5.4, 4.5, math.pi, "lab"),
            RobotStart(9.4, 2.6, math.pi, "hall"),
            RobotStart(8.5, 1.0, math.pi, "hall"),
            RobotStart(8.5, 4.0, math.pi, "hall"),
        ),
    ),
    "door": Site(
        two_halls,
        "box",
        (Pose(FLOOR, 3.5, 3.5, 0.0), Pose(FLOOR, 10.5, 3.5, 0.0)),
        (
            RobotStart(0.6, 0.6, 0.0, "lab"),
            RobotStart(0.6, 6.4, 0.0, "hall"),
            RobotStart(13.4, 0.6, math.pi, "hall"),
            RobotStart(13.4, 6.4, math.pi, "lab"),
        ),
    ),
    "elevator": Site(
        two_storeys,
        "box",
        (Pose(FLOOR, 5.4, 3.5, -0.785), Pose(UPPER, 5.4, 3.5, -0.785)),
        (
            RobotStart(0.6, 0.6, 0.0, "lab"),
            RobotStart(0.6, 6.4, 0.0, "hall"),
            RobotStart(0.6, 0.6, 0.0, "hall", floor=UPPER),
            RobotStart(0.6, 6.4, 0.0, "lab", floor=UPPER),
        ),
    ),
    "workshop": Site(
        workshop,
        "crate",
        (Pose(FLOOR, 2.6, 6.4, 0.5), Pose(UPPER, 5.2, 5.6, 2.0)),
        (
            RobotStart(1.8, 3.6, 0.0, "lab"),
            RobotStart(0.7, 7.8, 0.0, "hall"),
            RobotStart(13.4, 7.8, math.pi, "hall"),
            RobotStart(0.7, 7.8, 0.0, "lab", floor=UPPER),
        ),
    ),
    "storehouse": Site(
        storehouse,
        "crate",
        (Pose(FLOOR, 4.8, 4.0, 0.3), Pose(UPPER, 4.8, 4.0, 0.3)),
        (
            RobotStart(0.6, 0.6, 0.0, "lab"),
            RobotStart(0.6, 7.4, 0.0, "hall"),
            RobotStart(0.6, 4.0, 0.0, "lab"),
            RobotStart(4.8, 7.4, -1.57, "hall"),
            RobotStart(0.6, 0.6, 0.0, "lab", floor=UPPER),
        ),
    ),
}
