"""Robots and movable objects in the simulated building: each is on one floor, and robots grip objects there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping

import shapely

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.places import xy
from robocorba.errors.simulation import CannotGrip, InvalidChoice, PlaceTaken, UnknownBody, UnknownRobot
from robocorba.map_editor.lineage import Lineage
from robocorba.map_editor.model import ElementKind, MapObject
from robocorba.map_editor.movable import ambiguity, full_name, object_outline
from robocorba.map_editor.spatial.floor_update import Body, BodyKind
from robocorba.map_editor.spatial.frames import out_of
from robocorba.map_editor.spatial.pose import PAYLOAD_KG, Pose
from robocorba.simulation.body_names import is_robot, owner
from robocorba.simulation.physics import FloorPhysics
from robocorba.simulation.placed_object import PlacedObject
from robocorba.simulation.registry import Description, pose_faults
from robocorba.simulation.simulated_robot import SimulatedRobot
from robocorba.simulation.world_record import ObjectRecord, RobotRecord

#: Maximum distance of a grip point from the robot's centre [m].
MAX_REACH_M = 1.0
#: Maximum distance of a grip point from the object's outline [m].
MAX_GRIP_DISTANCE_M = 0.05
#: The body that a robot holds, and the grip point on the floor [m].
Held = tuple[str, tuple[float, float]]
#: Movable objects of a map, and their floors, by name.
MapObjects = Mapping[str, tuple[MapObject, str]]


class Occupants:
    """The robots and movable objects of a building, each on one floor. why_inaccessible: why no body can be put at a
    pose, whatever stands there; empty if one can.

    One thread may use it; SimulatedRobot is an exception."""

    def __init__(self, why_inaccessible: Callable[[Pose], str] = lambda pose: "") -> None:
        self._why_inaccessible = why_inaccessible
        #: The floors' physics, by name. Never changed in place.
        self.floors: Mapping[str, FloorPhysics] = {}
        self.robots: dict[str, SimulatedRobot] = {}
        #: Movable objects by name.
        self.objects: dict[str, PlacedObject] = {}
        #: As they are published, by their keys in the physics.
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
        if reason := self._why_inaccessible(description.pose):
            raise PlaceTaken(floor, x, y, reason)
        blocker = self.floors[floor].touching(x, y, description.radius_m)
        if blocker is not None:
            raise PlaceTaken(floor, x, y, self.name_of(blocker))
        return self._add_robot(description, description.pose)

    def restore_robot(self, description: Description, record: RobotRecord | None) -> None:
        """Add a robot as its record says, or at its start, without a look at who is there; not where the map has no
        such floor. It holds its object again if that is still between its hands."""
        pose = Pose(record.floor, record.x, record.y, record.heading) if record else description.pose
        if pose.floor not in self.floors:
            return
        robot = self._add_robot(description, pose)
        if record is None:
            return
        robot.collisions = record.collisions
        if record.grip and (held := self.find_object(record.grip[0])) and held.floor == pose.floor:
            at = record.grip[1:]
            if robot.physics.distance(held.body, at) <= MAX_GRIP_DISTANCE_M:  # else the map has moved it
                _grip(robot.physics, robot.body, (held.body, at))

    def remove_robot(self, name: str) -> None:
        """Remove a robot with its grip. Raises UnknownRobot."""
        robot = self.robot(name)
        robot.physics.remove(robot.body)
        del self.robots[name], self.published[robot.body]

    def _add_robot(self, description: Description, pose: Pose) -> SimulatedRobot:
        robot = SimulatedRobot(description, self._number(), pose.floor, self.floors[pose.floor], self.name_of)
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

    def object_pose(self, name: str) -> Pose:
        """Current pose of an object. Raises UnknownBody."""
        if name not in self.objects:
            raise UnknownBody(name)
        item = self.objects[name]
        return Pose(item.floor, *self.floors[item.floor].pose(item.body))

    def find_object(self, name: str, floor: str = "") -> PlacedObject | None:
        """An object by its name, or by FLOOR/NAME of the map; with a floor, also by its name on the map if it is the
        only one of this name there. None if there is no such object, or several."""
        if name in self.objects:
            return self.objects[name]
        found = [each for each in self.objects.values() if each.full_name == name] or [
            each for each in self.objects.values() if each.map_object.name == name and each.floor == floor
        ]
        return found[0] if len(found) == 1 else None

    def name_of(self, body: str) -> str:
        """Name of the robot or object of a body; empty for none. Thread-safe."""
        known = self.published.get(body)
        return known.name if known else ""

    def update_objects(self, after: MapObjects, lineage: Lineage) -> list[tuple[str, str]]:
        """Follow an edit of the map's movable objects. An object keeps its pose and the grips of it unless the edit
        moves it, or its floor is gone. Returns the robots that have lost their grips, and on which floors.

        lineage: which of the objects before each of `after` is."""
        before = {each.full_name: each for each in self.objects.values()}
        self.objects = {}
        lost: list[tuple[str, str]] = []
        for name, (map_object, floor) in after.items():
            origin = lineage.origin(ElementKind.OBJECT, floor, map_object.name)
            known = before.pop(full_name(origin.floor, origin.name), None) if origin else None
            if known is None:
                self._add_object(name, map_object, floor)
            else:
                lost += self._change_object(known, PlacedObject(known.number, name, map_object, floor, known.floor))
        for gone in before.values():
            lost += self._holders(gone.body)
            if gone.floor in self.floors:
                self.floors[gone.floor].remove(gone.body)
            del self.published[gone.body]
        return lost

    def move_object(self, name: str, pose: Pose) -> None:
        """Put an object at a pose, at rest; grips of it are released. No effect if the map has not both."""
        if name in self.objects and pose.floor in self.floors:
            item = self.objects[name]
            self.floors[item.floor].remove(item.body)
            self._put_object(item, pose)

    def _change_object(self, before: PlacedObject, after: PlacedObject) -> list[tuple[str, str]]:
        """Follow the edit of an object; return the robots that have lost their grips, and on which floors."""
        self.objects[after.name] = after
        if after.published() != self.published[after.body]:
            self.published[after.body] = after.published()
            if after.floor in self.floors:
                self.floors[after.floor].renew()
        same_place = (after.map_object.at, after.map_object.heading) == (
            before.map_object.at,
            before.map_object.heading,
        )
        if not same_place or after.floor not in self.floors:
            holders = self._holders(after.body)
            if after.floor in self.floors:
                self.floors[after.floor].remove(after.body)
            self._put_object(after, after.map_pose)
            return holders
        if (after.map_object.shape, after.mass_kg) != (before.map_object.shape, before.mass_kg):
            return self._reshape(after)
        return []

    def _reshape(self, item: PlacedObject) -> list[tuple[str, str]]:
        """Give an object its new shape and mass. Robots keep their grips where it is still between their hands."""
        physics = self.floors[item.floor]
        held = {each: grip for each, _ in self._holders(item.body) if (grip := self.held_by(each))}
        pose = physics.pose(item.body)
        physics.remove(item.body)
        self._put_object(item, Pose(item.floor, *pose))
        lost = []
        for robot, grip in held.items():
            if physics.distance(item.body, grip[1]) <= MAX_GRIP_DISTANCE_M:
                _grip(physics, self.robots[robot].body, grip)
            else:
                lost.append((robot, item.floor))
        return lost

    def _add_object(self, name: str, map_object: MapObject, floor: str) -> None:
        item = PlacedObject(self._number(), name, map_object, floor, floor)
        self.objects[name] = item
        self._put_object(item, item.map_pose)
        self.published[item.body] = item.published()

    def _put_object(self, item: PlacedObject, pose: Pose) -> None:
        item.floor = pose.floor
        self.floors[pose.floor].add_object(item.body, pose[1:], object_outline(item.map_object), item.mass_kg)

    def _holders(self, body: str) -> list[tuple[str, str]]:
        """The robots that hold a body, or whose body holds something, and their floors."""
        return [
            (each.name, each.floor)
            for each in self.robots.values()
            if (held := each.physics.held(each.body)) and body in (each.body, held[0])
        ]

    # ---- grips ----

    def grip(self, name: str, object_name: str, at: tuple[float, float]) -> None:
        """Let a robot grip an object at the point `at` [m]. Raises UnknownRobot, CannotGrip."""
        robot = self.robot(name)
        item = self.find_object(object_name, robot.floor)
        if item is None:
            no_such = f"there is no such movable object on {robot.floor}"
            raise CannotGrip(object_name, ambiguity(object_name, self.objects) or no_such)
        if item.floor != robot.floor:
            raise CannotGrip(object_name, f"it is on {item.floor}, {name} on {robot.floor}")
        if not math.isfinite(at[0] + at[1]):
            raise CannotGrip(object_name, f"({at[0]}, {at[1]}) is not a finite point")
        x, y, _ = robot.physics.pose(robot.body)
        point = f"({xy(*at)})"
        distance_m = math.hypot(at[0] - x, at[1] - y)
        if distance_m > MAX_REACH_M:
            raise CannotGrip(object_name, f"{point} is {distance_m:.2f} m away; hands reach {MAX_REACH_M:g} m")
        gap_m = robot.physics.distance(item.body, at)
        if gap_m > MAX_GRIP_DISTANCE_M:
            reason = f"{point} is {gap_m:.2f} m off its outline; at most {MAX_GRIP_DISTANCE_M:g} m"
            raise CannotGrip(object_name, reason)
        _grip(robot.physics, robot.body, (item.body, at))
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
            _grip(robot.physics, robot.body, held)
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
        for field, reason in pose_faults(pose):
            raise InvalidChoice(f"at.{field}", reason)
        floor, x, y, _ = pose
        robot, item = self.robots.get(name), self.find_object(name)
        if robot is None and item is None:
            if why := ambiguity(name, self.objects):
                raise InvalidChoice("body", why)
            raise UnknownBody(name)
        if floor not in self.floors:
            raise UnknownFloor("at.floor", floor[:200], list(self.floors))
        if reason := self._why_inaccessible(pose):
            raise PlaceTaken(floor, x, y, reason)
        physics = self.floors[floor]
        if robot:
            body, blocker = robot.body, physics.touching(x, y, robot.description.radius_m, robot.body)
        else:
            assert item
            body = item.body
            blocker = physics.overlapping(object_outline(item.map_object), pose[1:], body)
        if blocker is not None:
            raise PlaceTaken(floor, x, y, self.name_of(blocker))
        holders = self._holders(body)
        if robot:
            robot.physics.remove(body)
            self._put_robot(robot, pose)
        elif item:
            self.move_object(item.name, pose)
        return holders

    def within(self, area: shapely.Polygon, floor: str) -> list[str]:
        """Names of the bodies whose centres are within an area of a floor."""
        rows = self.floors[floor].state()
        return [body for body, row in rows.items() if area.contains(shapely.Point(row[0], row[1]))]

    def exchange(self, area: shapely.Polygon, origin: str, destination: str) -> None:
        """Exchange the bodies whose centres are within an area of two floors, so that none appears in another one."""
        here, there = self.within(area, origin), self.within(area, destination)
        self._transfer(here, origin, destination)
        self._transfer(there, destination, origin)

    def _transfer(self, bodies: Iterable[str], origin: str, destination: str) -> None:
        """Move bodies to the same poses of another floor, with their grips of each other."""
        before, after = self.floors[origin], self.floors[destination]
        poses = {body: before.pose(body) for body in bodies}
        objects = {item.body: item for item in self.objects.values()}
        grips = {body: held for body in poses if (held := before.held(body))}
        for body, pose in poses.items():
            before.remove(body)
            if is_robot(body):
                self._put_robot(self.robots[owner(body)], Pose(destination, *pose))
            else:
                self._put_object(objects[body], Pose(destination, *pose))
        for body, (held_body, at) in grips.items():
            if held_body in poses:
                _grip(after, body, (held_body, at))

    def use_floors(self, floors: Mapping[str, FloorPhysics], names: Mapping[str, str]) -> None:
        """Use the floors of an edited map. names: the present names of those that have stayed, by their former ones; no
        robot is on another one."""
        self.floors = floors
        for name, physics in floors.items():
            physics.rename(name)
        for robot in self.robots.values():
            robot.floor = names[robot.floor]
        for item in self.objects.values():
            item.floor = names.get(item.floor, "")

    def refresh(self) -> None:
        """Update the published state of all floors."""
        for physics in self.floors.values():
            physics.refresh()

    def robot_records(self) -> dict[str, RobotRecord]:
        """The robots' poses and grips, by name. Objects have their full names."""
        full_names = {item.body: item.full_name for item in self.objects.values()}
        found = {}
        for robot in self.robots.values():
            held = robot.physics.held(robot.body)
            grip = (full_names[held[0]], *held[1]) if held else None
            found[robot.name] = RobotRecord(robot.floor, *robot.physics.pose(robot.body), grip, robot.collisions)
        return found

    def object_records(self) -> dict[str, ObjectRecord]:
        """Floors and poses of the objects that are not at their poses on the map, by full name."""
        poses = ((item, self.object_pose(name)) for name, item in self.objects.items())
        return {item.full_name: ObjectRecord(*pose, item.map_pose) for item, pose in poses if pose != item.map_pose}

    def restore_object(self, name: str, record: ObjectRecord) -> None:
        """Put an object where its record says, unless the map has moved it since."""
        item = self.find_object(name)
        if item and record.map_pose in (None, item.map_pose):
            self.move_object(item.name, Pose(record.floor, record.x, record.y, record.heading))

    def count_collision(self, body: str, other: str) -> None:
        """Note that a body touched another one, or a static obstacle: a body without a name."""
        robot = self.robots.get(owner(body)) if is_robot(body) else None
        if robot:
            robot.collisions += 1
            robot.touched = self.name_of(other)

    def _number(self) -> int:
        self._numbers += 1
        return self._numbers


def _grip(physics: FloorPhysics, robot: str, held: Held) -> None:
    """Let a robot's body hold another one."""
    physics.grip(robot, *held, 200.0, PAYLOAD_KG)  # with at most 200 N
