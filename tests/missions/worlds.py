"""A World that consists of a map only."""

from __future__ import annotations

import math
from collections.abc import Sequence

import msgspec

from robocorba.errors.robots import MissionFailed
from robocorba.maps.geometry import Obstacle, object_geometry
from robocorba.maps.model import BoxShape, Building, CabinSide, Elevator, ElevatorDoor, Floor, MapObject
from robocorba.maps.movable import movables, object_outline
from robocorba.maps.topology import topological_map
from robocorba.missions.world import MovableObject, StandingRobot
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Path, PathRequest
from robocorba.testing.buildings import with_all


class MapWorld:
    """Objects are at their places on the map; each has the same mass. standing: the robots."""

    def __init__(self, building: Building, mass_kg: float = 2.0, standing: Sequence[StandingRobot] = ()) -> None:
        self.standing = list(standing)
        self._building, self._mass_kg = building, mass_kg
        self._planner = PathPlanner(building)

    def building(self) -> Building:
        return self._building

    def movable(self, name: str) -> MovableObject:
        known = movables(self._building)
        if name not in known:
            raise MissionFailed(f"there is no object {name!r}")
        entry, floor = known[name]
        return MovableObject(name, floor, *entry.at, entry.heading, object_outline(entry), self._mass_kg, entry.height)

    def others(self, carried: str) -> dict[str, list[Obstacle]]:
        found: dict[str, list[Obstacle]] = {}
        for name, (entry, floor) in movables(self._building).items():
            if name != carried:
                found.setdefault(floor, []).append(Obstacle("object", name, object_geometry(entry)))
        return found

    def robots(self) -> list[StandingRobot]:
        return self.standing

    def paths(self, request: PathRequest) -> Sequence[Path]:
        return self._planner.paths(request)


def two_storeys(cabin_m: float = 3.0, speed: float = 1.0) -> Building:
    """Two floors of 12 m by 7 m with an elevator between them, and a box that two robots carry on the lower one."""
    outline = ((0.0, 0.0), (12.0, 0.0), (12.0, 7.0), (0.0, 7.0))
    width = cabin_m - 0.6
    doors = tuple(ElevatorDoor(floor=name, side=CabinSide.FRONT, width=width) for name in ("L1", "L2"))
    east = 8.0 + cabin_m / 2, 3.5
    elevator = Elevator("E1", east, (cabin_m, cabin_m), doors, heading=-math.pi / 2, speed=speed, door_time=2.0)
    shape = BoxShape(size=(0.6, 0.4))
    box = MapObject(name="box", shape=shape, at=(5.4, 3.5), heading=-0.785, height=0.8, movable=True)
    building = with_all(
        Building("two storeys"),
        [
            ("", Floor(name="L1", level=1, elevation=0.0, outline=outline)),
            ("", Floor(name="L2", level=2, elevation=3.0, outline=outline)),
            ("", elevator),
            ("L1", box),
        ],
    )
    for name, floor in building.floors.items():
        building.floors[name] = msgspec.structs.replace(floor, topological=topological_map(building, name))
    return building
