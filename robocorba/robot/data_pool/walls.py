"""Fixed obstacles of one floor: walls, the floor's bounds, locked doors, elevator shafts, and objects that can't be
moved."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
import shapely
from shapely import Point, STRtree
from shapely.geometry.base import BaseGeometry

from robocorba.errors.paths import UnknownFloor
from robocorba.map_editor.geometry import compute_obstacles, shaft_polygon
from robocorba.map_editor.model import Building, Elevator, Floor, GeometricalMap
from robocorba.map_editor.movable import landing_doors, movables
from robocorba.map_editor.spatial.arrays import Floats
from robocorba.map_editor.spatial.elevator_state import Doors, ElevatorState


class NearbyObstacle(NamedTuple):
    """The obstacle nearest to a point: its distance, 0 inside it, its nearest point (x, y) [m], and its name.

    The name is that of a wall, a door, an object or a robot; of the elevator for a shaft and landing doors; of the
    floor for the floor's bounds."""

    distance_m: float
    x: float
    y: float
    name: str


class Walls:
    """The fixed obstacles of one floor of `building`; keeps no reference to the building. Thread-safe. Raises
    UnknownFloor."""

    def __init__(self, building: Building, floor: str) -> None:
        self.floor = floor
        self._plan = plan, floor_data, elevators = _plan_of(building, floor)
        this_floor = Building(building.name, {floor: building.floors[floor]}, building.elevators)
        movable = {item.name for item, _ in movables(this_floor).values()}
        # Not maps.geometry.obstacles, which would cache this floor after the robot has left it.
        fixed = [
            item
            for item in compute_obstacles(plan, floor_data, elevators)
            if not item.geometry.is_empty and not (item.kind == "object" and item.name in movable)
        ]
        self._names = [item.name for item in fixed]
        self._tree = STRtree([item.geometry for item in fixed])
        self._doors = {
            elevator.name: landing_doors(this_floor, elevator.name, floor)
            for elevator in elevators
            if floor in elevator.floors()
        }
        #: The shafts of elevators, by name.
        self.shafts = {elevator.name: shaft_polygon(elevator) for elevator in elevators}
        #: The map's objects that can't be moved, by name.
        self.objects = {name: item for name, item in plan.objects.items() if name not in movable}

    def match(self, building: Building) -> bool:
        """Whether this floor has the same plan in `building`. Raises UnknownFloor."""
        return self._plan == _plan_of(building, self.floor)

    def nearest(self, x: float, y: float, elevators: Mapping[str, ElevatorState]) -> NearbyObstacle | None:
        """The fixed obstacle nearest to a point (x, y) [m]; None on an empty floor.

        Landing doors are obstacles until the elevator's doors are open here."""
        point = Point(x, y)
        found = [
            nearest_of(point, lines, name) for name, lines in self._doors.items() if not self._is_open(elevators, name)
        ]
        row = self._tree.nearest(point)
        if row is not None:
            found.append(nearest_of(point, self._tree.geometries[row], self._names[row]))
        return min(found, default=None)

    def near(self, points: Floats, within_m: Floats) -> npt.NDArray[np.bool_]:
        """Which points (n, 2) are within some distances (n,) of fixed obstacles or landing doors [m], open or not."""
        where, found = shapely.points(points), np.zeros(len(points), bool)
        found[self._tree.query(where, "dwithin", within_m)[0]] = True
        for lines in self._doors.values():
            found |= shapely.dwithin(where, lines, within_m)
        return found

    def distance_m(self, shape: BaseGeometry) -> float:
        """Distance of a shape from the fixed obstacles but landing doors [m]; infinite on an empty floor."""
        row = self._tree.nearest(shape)
        return math.inf if row is None else float(shapely.distance(self._tree.geometries[row], shape))

    def _is_open(self, elevators: Mapping[str, ElevatorState], name: str) -> bool:
        state = elevators.get(name)
        return bool(state and state.floor == self.floor and state.doors is Doors.OPEN)


def nearest_of(point: Point, shape: BaseGeometry, name: str) -> NearbyObstacle:
    """The distance of a shape from a point, and the shape's nearest point."""
    (x, y), _ = shapely.get_coordinates(shapely.shortest_line(shape, point)).tolist()
    return NearbyObstacle(float(shapely.distance(shape, point)), x, y, name)


def _plan_of(building: Building, floor: str) -> tuple[GeometricalMap, Floor, tuple[Elevator, ...]]:
    """What the walls of a floor depend on."""
    if floor not in building.floors:
        raise UnknownFloor("floor", floor, list(building.floors))
    entry = building.floors[floor]
    return entry.geometrical, entry.floor, building.elevators_through(floor)
