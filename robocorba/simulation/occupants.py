"""Robots and movable objects in the simulated building: each is on one floor, and robots grip objects there."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import shapely

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.places import xy
from robocorba.errors.simulation import CannotGrip, InvalidChoice, PlaceTaken, UnknownBody, UnknownRobot
from robocorba.maps.model import MapObject
from robocorba.maps.movable import object_outline
from robocorba.simulation.body_names import is_robot, object_body, owner
from robocorba.simulation.physics import FloorPhysics
from robocorba.simulation.registry import Description
from robocorba.simulation.simulated_robot import SimulatedRobot
from robocorba.simulation.world_record import RobotRecord
from robocorba.spatial.floor_update import Body, BodyKind
from robocorba.spatial.frames import out_of
from robocorba.spatial.pose import Pose

#: Mass of a movable object per area of its outline [kg/m^2]; maps hold no masses. Three robots lift up to 1.33 m^2.
KG_PER_SQUARE_METRE = 9.0
#: Maximum distance of a grip point from the robot's centre [m].
MAX_REACH_M = 1.0
#: Maximum force of a grip [N].
MAX_GRIP_FORCE_N = 200.0
#: Mass that one robot carries [kg]: a SmartPal grips with both hands, 2 kg each.
PAYLOAD_KG = 4.0
#: Maximum distance of a grip point from the object's outline [m].
MAX_GRIP_DISTANCE_M = 0.05
#: Bounds of the coordinates [m] and the heading [rad] of a pose at which a body is placed.
MAX_COORDINATE_M, MAX_HEADING = 1e6, 1e3
#: The body that a robot holds, and the grip point on the floor [m].
Held = tuple[str, tuple[float, float]]
#: Movable objects of a map, and their floors, by name.
MapObjects = Mapping[str, tuple[MapObject, str]]


class Occupants:
    """The robots and movable objects of a building, each on one floor.

    One thread may use it; SimulatedRobot is an exception."""

    def __init__(self) -> None:
        #: The floors' physics, by name. Never changed in place.
        self.floors: Mapping[str, FloorPhysics] = {}
        self.robots: dict[str, SimulatedRobot] = {}
        #: Movable objects by name: the object on the map, and its current floor.
        self.objects: dict[str, tuple[MapObject, str]] = {}
        #: As they are published, by the name of the body.
        self.published: dict[str, Body] = {}
        self._numbers = 0

    # ---- robots ----

    def robot(self, name: str) -> SimulatedRobot:
        """A robot by its name. Raises UnknownRobot."""
        if name not in self.robots:
            raise UnknownRobot(name)
        return self.robots[name]

    def pose(self, name: str) -> Pose:
        """Current pose of a robot. Raises UnknownRobot."""
        robot = self.robot(name)
        return Pose(robot.floor, *robot.physics.pose(robot.body))

    def add_robot(self, description: Description) -> SimulatedRobot:
        """Add a robot at the pose of its description; its name must be free. Raises UnknownFloor, PlaceTaken."""
        floor, x, y, _ = description.pose
        if floor not in self.floors:
            raise UnknownFloor("start", floor, list(self.floors))
        blocker = self.floors[floor].touching(x, y, description.radius_m)
        if blocker is not None:
            raise PlaceTaken(floor, x, y, owner(blocker))
        return self._add_robot(description, description.pose)

    def restore_robot(self, description: Description, record: RobotRecord | None) -> None:
        """Add a robot as its record says, or at its start, without a look at who is there; not where the map has no
        such floor. It holds its object again if that is on its floor."""
        pose = Pose(record.floor, record.x, record.y, record.heading) if record else description.pose
        if pose.floor not in self.floors:
            return
        robot = self._add_robot(description, pose)
        if record is None:
            return
        robot.collisions = record.collisions
        if record.grip and self.objects.get(record.grip[0], (None, ""))[1] == pose.floor:
            held, x, y = record.grip
            robot.physics.grip(robot.body, object_body(held), (x, y), MAX_GRIP_FORCE_N, PAYLOAD_KG)

    def remove_robot(self, name: str) -> None:
        """Remove a robot with its grip. Raises UnknownRobot."""
        robot = self.robot(name)
        robot.physics.remove(robot.body)
        del self.robots[name], self.published[robot.body]

    def _add_robot(self, description: Description, pose: Pose) -> SimulatedRobot:
        robot = SimulatedRobot(description, self._number(), pose.floor, self.floors[pose.floor])
        self.robots[description.name] = robot
        self.published[robot.body] = Body(
            robot.number, BodyKind.ROBOT, robot.name, description.radius_m, (), description.mass_kg
        )
        self._put_robot(robot, pose)
        return robot

    def _put_robot(self, robot: SimulatedRobot, pose: Pose) -> None:
        description = robot.description
        physics = self.floors[pose.floor]
        physics.add_robot(robot.body, pose[1:], description.radius_m, description.mass_kg, description.limits)
        robot.floor, robot.physics = pose.floor, physics

    # ---- objects ----

    def update_objects(self, before: MapObjects, after: MapObjects) -> None:
        """Follow an edit of the map's movable objects. Those that it did not change keep their poses, unless they are
        on a floor that is gone."""
        for name, (_, floor) in list(self.objects.items()):
            if floor not in self.floors or after.get(name) != before[name]:
                self._remove_object(name)
        for name, (map_object, floor) in after.items():
            if name not in self.objects:
                self._add_object(name, map_object, floor)

    def move_object(self, name: str, pose: Pose) -> None:
        """Put an object at a pose, at rest; grips of it are released. No effect if the map has not both."""
        if name in self.objects and pose.floor in self.floors:
            map_object, floor = self.objects[name]
            self.floors[floor].remove(object_body(name))
            self._put_object(name, map_object, pose)

    def _add_object(self, name: str, map_object: MapObject, floor: str) -> None:
        self._put_object(name, map_object, Pose(floor, *map_object.at, map_object.heading))
        corners = list(object_outline(map_object).exterior.coords[:-1])
        radius_m = max(math.hypot(x, y) for x, y in corners)
        body = object_body(name)
        mass_kg = self.floors[floor].mass_kg(body)
        self.published[body] = Body(self._number(), BodyKind.OBJECT, name, radius_m, tuple(corners), mass_kg)

    def _put_object(self, name: str, map_object: MapObject, pose: Pose) -> None:
        shape = object_outline(map_object)
        self.objects[name] = (map_object, pose.floor)
        self.floors[pose.floor].add_object(object_body(name), pose[1:], shape, KG_PER_SQUARE_METRE * shape.area)

    def _remove_object(self, name: str) -> None:
        _, floor = self.objects.pop(name)
        del self.published[object_body(name)]
        if floor in self.floors:
            self.floors[floor].remove(object_body(name))

    # ---- grips ----

    def grip(self, name: str, object_name: str, at: tuple[float, float]) -> None:
        """Let a robot grip an object at the point `at` [m]. Raises UnknownRobot, CannotGrip."""
        robot = self.robot(name)
        if object_name not in self.objects or self.objects[object_name][1] != robot.floor:
            raise CannotGrip(object_name, f"there is no such movable object on {robot.floor}")
        if not math.isfinite(at[0] + at[1]):
            raise CannotGrip(object_name, f"({at[0]}, {at[1]}) is not a finite point")
        x, y, _ = robot.physics.pose(robot.body)
        point = f"({xy(*at)})"
        distance_m = math.hypot(at[0] - x, at[1] - y)
        if distance_m > MAX_REACH_M:
            raise CannotGrip(object_name, f"{point} is {distance_m:.2f} m away; hands reach {MAX_REACH_M:g} m")
        gap_m = robot.physics.distance(object_body(object_name), at)
        if gap_m > MAX_GRIP_DISTANCE_M:
            reason = f"{point} is {gap_m:.2f} m off its outline; at most {MAX_GRIP_DISTANCE_M:g} m"
            raise CannotGrip(object_name, reason)
        robot.physics.grip(robot.body, object_body(object_name), at, MAX_GRIP_FORCE_N, PAYLOAD_KG)
        robot.physics.refresh()

    def held_by(self, name: str) -> Held | None:
        """What a robot holds, for `hold_again`. Raises UnknownRobot."""
        robot = self.robot(name)
        return robot.physics.held(robot.body)

    def hold_again(self, name: str, held: Held | None) -> None:
        """Undo a grip: hold what `held_by` has returned before. Raises UnknownRobot."""
        robot = self.robot(name)
        robot.physics.release(robot.body)
        if held:
            robot.physics.grip(robot.body, *held, MAX_GRIP_FORCE_N, PAYLOAD_KG)
        robot.physics.refresh()

    def release(self, name: str) -> None:
        """Release the held object, if any. Raises UnknownRobot."""
        robot = self.robot(name)
        robot.physics.release(robot.body)
        robot.physics.refresh()

    def held_outline(self, name: str) -> shapely.Polygon | None:
        """The outline of what a robot holds, on its floor [m]. Raises UnknownRobot."""
        held = self.held_by(name)
        if held is None:
            return None
        pose = self.robots[name].physics.pose(held[0])
        return shapely.Polygon([out_of(x, y, pose) for x, y in self.published[held[0]].outline])

    # ---- both ----

    def place(self, name: str, pose: Pose) -> list[tuple[str, str]]:
        """Put a robot or a movable object at a pose, at rest; grips of it and by it are released. Returns the robots
        that have lost theirs, and on which floors. Raises UnknownBody, UnknownFloor, PlaceTaken, InvalidChoice."""
        _check_finite(pose)
        floor, x, y, _ = pose
        if name not in self.robots and name not in self.objects:
            raise UnknownBody(name)
        if floor not in self.floors:
            raise UnknownFloor("at.floor", floor[:200], list(self.floors))
        robot, physics = self.robots.get(name), self.floors[floor]
        body = robot.body if robot else object_body(name)
        if robot:
            blocker = physics.touching(x, y, robot.description.radius_m, body)
        else:
            blocker = physics.overlapping(object_outline(self.objects[name][0]), pose[1:], body)
        if blocker is not None:
            raise PlaceTaken(floor, x, y, owner(blocker))
        holders = [
            (each.name, each.floor)
            for each in self.robots.values()
            if (held := each.physics.held(each.body)) and body in (each.body, held[0])
        ]
        if robot:
            robot.physics.remove(body)
            self._put_robot(robot, pose)
        else:
            self.move_object(name, pose)
        return holders

    def within(self, area: shapely.Polygon, floor: str) -> list[str]:
        """Names of the bodies whose centres are within an area of a floor."""
        rows = self.floors[floor].state()
        return [body for body, row in rows.items() if area.contains(shapely.Point(row[0], row[1]))]

    def transfer(self, bodies: Iterable[str], origin: str, destination: str) -> None:
        """Move bodies to the same poses of another floor, with their grips of each other."""
        before, after = self.floors[origin], self.floors[destination]
        poses = {body: before.pose(body) for body in bodies}
        grips = {body: held for body in poses if (held := before.held(body))}
        for body, pose in poses.items():
            before.remove(body)
            if is_robot(body):
                self._put_robot(self.robots[owner(body)], Pose(destination, *pose))
            else:
                self._put_object(owner(body), self.objects[owner(body)][0], Pose(destination, *pose))
        for body, (held_body, at) in grips.items():
            if held_body in poses:
                after.grip(body, held_body, at, MAX_GRIP_FORCE_N, PAYLOAD_KG)

    def refresh(self) -> None:
        """Update the published state of all floors."""
        for physics in self.floors.values():
            physics.refresh()

    def robot_records(self) -> dict[str, RobotRecord]:
        """The robots' poses and grips, by name."""
        found = {}
        for robot in self.robots.values():
            held = robot.physics.held(robot.body)
            grip = (owner(held[0]), *held[1]) if held else None
            found[robot.name] = RobotRecord(robot.floor, *robot.physics.pose(robot.body), grip, robot.collisions)
        return found

    def object_records(self) -> dict[str, tuple[str, float, float, float]]:
        """The objects' floors and poses, by name."""
        return {name: (floor, *self.floors[floor].pose(object_body(name))) for name, (_, floor) in self.objects.items()}

    def count_collision(self, body: str, other: str) -> None:
        """Note that a body touched another one, or a static obstacle: a body without a name."""
        robot = self.robots.get(owner(body)) if is_robot(body) else None
        if robot:
            robot.collisions += 1
            robot.touched = owner(other)

    def _number(self) -> int:
        self._numbers += 1
        return self._numbers


def _check_finite(pose: Pose) -> None:
    """Raise InvalidChoice unless the coordinates and the heading are numbers within their bounds."""
    for field, value, limit in (
        ("x", pose.x, MAX_COORDINATE_M),
        ("y", pose.y, MAX_COORDINATE_M),
        ("heading", pose.heading, MAX_HEADING),
    ):
        if not abs(value) <= limit:  # also refuses NaN
            raise InvalidChoice(f"at.{field}", f"{value} is not a number between -{limit:g} and {limit:g}")
