"""The map on a robot's own computer: its file, its planner, and the floor of the robot's data pool."""

from __future__ import annotations

import itertools
import threading
from collections.abc import Callable

import msgspec
import numpy as np

from robocorba.errors.paths import UnknownFloor
from robocorba.map_editor import native
from robocorba.map_editor.model import Building
from robocorba.map_editor.movable import movables
from robocorba.map_editor.spatial.floor_update import MOTION, Body, BodyKind, FloorUpdate
from robocorba.map_editor.spatial.frames import turned
from robocorba.planning.planner import PathPlanner
from robocorba.planning.request import Path, PathRequest
from robocorba.robot.data_pool.snapshot import entity_of_map_object
from robocorba.robot.kinematics.smartpal import MASS_KG, RADIUS_M
from robocorba.robot.motion.robot_state import RobotState
from robocorba.system.record_file import RecordFile


class KeptMap(msgspec.Struct):
    """A building as the text of a map file, and the version that it has at the map editor."""

    version: int
    text: str


def kept_map(records: RecordFile) -> KeptMap | None:
    """The map that the robot's computer had last; None if it never had one."""
    return next(iter(records.all("map", KeptMap)), None)


class LocalMap:
    """A Planner, thread-safe. Paths keep to one floor: rides need the simulation server."""

    def __init__(self, records: RecordFile, building: Building, version: int, floor: str) -> None:
        """Raises UnknownFloor."""
        self._records, self.floor = records, floor
        _require(building, floor)
        self.building, self.version = building, version
        self.planner = PathPlanner(building, version)

    def take(self, building: Building, version: int) -> None:
        """Replace the map by another version, and keep that. Raises ServiceError."""
        self._records.save("map", "", KeptMap(version, native.dumps(building)))
        self.building, self.version = building, version
        self.planner.update(building, version)

    def paths(self, request: PathRequest) -> list[Path]:
        """The best path first, without elevators. Raises PathError."""
        return self.planner.paths(request._replace(avoid_elevators=frozenset(self.building.elevators)))

    def of(self, floor: str) -> Building:
        """A building of this floor with all its obstacles, and of all elevators. Raises UnknownFloor."""
        building = self.building
        _require(building, floor)
        return Building(building.name, {floor: building.floors[floor]}, building.elevators)


class LocalFloor:
    """What a data pool loads without an Omni database: the robot `name`, and movable objects where the map has them.
    robot: returns the robot's state."""

    def __init__(self, place: LocalMap, name: str, robot: Callable[[], RobotState]) -> None:
        self._place, self._name, self._robot = place, name, robot
        self._lock = threading.Lock()
        self._numbers = itertools.count(1)
        #: The version of the map, and of the floor, that the last update had.
        self._map_version, self._version = -1, 0

    def changes(self, floor: str, since: int) -> FloorUpdate:
        """The changes on the floor since a version: where the robot is; all of it if the map has changed. Raises
        UnknownFloor."""
        with self._lock:
            place, robot = self._place.of(floor), self._robot()
            map_version = self._place.version
            is_whole = since != self._version or map_version != self._map_version
            self._version, self._map_version = next(self._numbers), map_version
            own = Body(1, BodyKind.ROBOT, self._name, RADIUS_M, (), MASS_KG)
            vx, vy = turned(robot.velocity[0], robot.velocity[1], robot.heading)
            rows, bodies = [(1, vx, vy, robot.velocity[2], robot.x, robot.y, robot.heading)], []
            if is_whole:
                bodies.append(own)
                for number, (name, (item, _)) in enumerate(movables(place).items(), 2):
                    found = entity_of_map_object(item)
                    bodies.append(Body(number, BodyKind.OBJECT, name, found.radius_m, found.outline, item.mass))
                    rows.append((number, 0.0, 0.0, 0.0, *item.at, item.heading))
            motions = np.array(rows, MOTION)
            begin = 0 if is_whole else since
            return FloorUpdate(floor, begin, self._version, robot.time, map_version, bodies, [], motions, {})


def _require(building: Building, floor: str) -> None:
    if floor not in building.floors:
        raise UnknownFloor("floor", floor, list(building.floors))
