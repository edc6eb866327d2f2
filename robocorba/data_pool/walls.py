"""What stands on one floor: walls, its bounds, locked doors, shafts of elevators, and objects that can't be moved."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import shapely
from shapely import Point, STRtree
from shapely.geometry.base import BaseGeometry

from robocorba.errors.paths import UnknownFloor
from robocorba.maps.geometry import blocking
from robocorba.maps.model import Building, Elevator, Floor, GeometricalMap
from robocorba.maps.movable import landing_doors, movables
from robocorba.spatial.elevator_state import Doors, ElevatorState


class Nearest(NamedTuple):
    """What is nearest to a place: how far it is, 0 within it, where, m, and its name: that of a wall, a door, an object
    or a robot; of an elevator for its shaft and its doors, of the floor for its bounds."""

    distance_m: float
    x: float
    y: float
    name: str


class Walls:
    """Of a floor of `building`, of which nothing else is kept. Any thread may ask. Raises UnknownFloor."""

    def __init__(self, building: Building, floor: str) -> None:
        self.floor = floor
        self._plan = plan, about, elevators = _plan_of(building, floor)
        alone = Building(building.name, {floor: building.floors[floor]}, building.elevators)
        can_move = {thing.name for thing, _ in movables(alone).values()}
        # `obstacles` would remember this floor after the robot has left it.
        standing = [
            item
            for item in blocking(plan, about, elevators)
            if not item.geometry.is_empty and not (item.kind == "object" and item.name in can_move)
        ]
        self._names = [item.name for item in standing]
        self._tree = STRtree([item.geometry for item in standing])
        self._doors = {
            elevator.name: landing_doors(alone, elevator.name, floor)
            for elevator in elevators
            if floor in elevator.floors()
        }
        #: Those that can't be moved, as the map has them.
        self.objects = {name: thing for name, thing in plan.objects.items() if name not in can_move}

    def are_those_of(self, building: Building) -> bool:
        """Whether the floor is the same there. Raises UnknownFloor."""
        return self._plan == _plan_of(building, self.floor)

    def nearest(self, x: float, y: float, elevators: Mapping[str, ElevatorState]) -> Nearest | None:
        """What is nearest to a place, m, with the elevators like this, whose doors stand in the way until they are
        open. None where nothing stands."""
        place = Point(x, y)
        found = [
            nearest_of(place, lines, name) for name, lines in self._doors.items() if not self._is_open(elevators, name)
        ]
        row = self._tree.nearest(place)
        if row is not None:
            found.append(nearest_of(place, self._tree.geometries[row], self._names[row]))
        return min(found, default=None)

    def _is_open(self, elevators: Mapping[str, ElevatorState], name: str) -> bool:
        moment = elevators.get(name)
        return bool(moment and moment.floor == self.floor and moment.doors is Doors.OPEN)


def nearest_of(place: Point, shape: BaseGeometry, name: str) -> Nearest:
    """How near a shape is to a place."""
    (x, y), _ = shapely.get_coordinates(shapely.shortest_line(shape, place)).tolist()
    return Nearest(float(shapely.distance(shape, place)), x, y, name)


def _plan_of(building: Building, floor: str) -> tuple[GeometricalMap, Floor, tuple[Elevator, ...]]:
    if floor not in building.floors:
        raise UnknownFloor("floor", floor, list(building.floors))
    entry = building.floors[floor]
    return entry.geometrical, entry.floor, tuple(building.elevators.values())
