"""A small building and robots for tests."""

from __future__ import annotations

from typing import Any

import numpy as np

from robocorba.maps.model import (
    BoxShape,
    Building,
    Elevator,
    ElevatorDoor,
    Floor,
    FloorMap,
    GeometricalMap,
    MapObject,
    Wall,
)
from robocorba.simulation.registry import Description
from robocorba.simulation.robot_scans import RobotScan
from robocorba.spatial.floor_state import Pose


def tower() -> Building:
    """Two floors of 10 x 10 m, an elevator in the middle with its door to the front, a table and a shelf below."""
    lift = Elevator("E1", (5.0, 5.0), (2.0, 2.0), (ElevatorDoor("L1"), ElevatorDoor("L2")), speed=2.0, door_time=1.0)
    table = MapObject("T1", BoxShape((1.0, 0.6)), (2.0, 2.0), 0.3, movable=True)
    shelf = MapObject("S1", BoxShape((1.0, 0.6)), (8.0, 8.0))
    square = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0))
    plan = GeometricalMap({"W1": Wall("W1", (3.0, 0.0), (3.0, 3.0))}, {"T1": table, "S1": shelf})
    floors = {
        "L1": FloorMap(Floor("L1", 1, 0.0, outline=square), plan),
        "L2": FloorMap(Floor("L2", 2, 4.0, outline=square)),
    }
    return Building("tower", floors, {"E1": lift})


def robot(name: str, floor: str = "L1", x: float = 7.0, y: float = 2.0, heading: float = 0.0) -> Description:
    return Description(name, Pose(floor, x, y, heading))


def scan(robot: str = "A", time: float = 1.0, floor: str = "L1", ahead: float = 0.0, **others: Any) -> RobotScan:
    """A laser's scan, `others` being different."""
    known: dict[str, Any] = {
        "first_rad": -1.0,
        "step_rad": 0.5,
        "range_m": 8.0,
        "rim_m": 0.0,
        "noise": (0.0, 0.0, 0.0, 0),
        "distances": np.full(5, 8.0),
        "hits": np.zeros(5, bool),
    }
    return RobotScan(robot, time, Pose(floor, 1.0, 2.0, 0.0), (ahead, 0.0, 0.0), **{**known, **others})
