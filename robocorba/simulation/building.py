"""The simulated building: floors with their physics, elevators between them, and time.

Robots and objects belong to the floor on which they stand. A cabin takes along whatever stands in its shaft, which
is on the floor where the ride begins until the doors open elsewhere.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import shapely
import shapely.affinity
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from robocorba.errors import PlaceTaken, UnknownElement, UnknownFloor, UnknownRobot
from robocorba.maps.geometry import landing_line, object_geometry, obstacles, shaft_polygon
from robocorba.maps.model import Building, MapObject, SegmentShape
from robocorba.simulation.elevator import Cabin, Doors, Phase
from robocorba.simulation.physics import STEP_S, FloorPhysics
from robocorba.simulation.registry import Description, Pose

#: Mass of a movable object, kg for a square metre of its outline; maps don't tell it.
KG_A_SQUARE_METRE = 20.0
#: How far a hand reaches from the middle of its robot, m; how hard it holds, and what it carries.
REACH_M, HAND_FORCE_N, PAYLOAD_KG = 1.0, 200.0, 4.0


class Robot:
    """A robot in the building, and its floor."""

    def __init__(self, description: Description) -> None:
        self.description = description
        self.floor = description.pose.floor


class Happening(NamedTuple):
    """Something that robots and the monitor are told: "collision", "grip lost" or "ride lost"."""

    time: float
    floor: str
    kind: str
    who: tuple[str, ...]
    reason: str = ""


class SimulatedBuilding:
    """Floors and elevators as `building` has them; movable objects stand where it says until they are moved."""

    def __init__(self, building: Building) -> None:
        self.building = building
        self.robots: dict[str, Robot] = {}
        self.floors: dict[str, FloorPhysics] = {}
        self.cabins: dict[str, Cabin] = {}
        #: Movable objects: as they are on the map, and their floor now.
        self.objects: dict[str, tuple[MapObject, str]] = {}
        self._steps = 0
        self._where: dict[str, tuple[str, Doors]] = {}
        for name in building.floors:
            self.floors[name] = FloorPhysics(standing(building, name))
            for thing in movable(building, name):
                self._add_object(thing, name, (*thing.at, thing.heading))
        for name, elevator in building.elevators.items():
            heights = {floor: building.floors[floor].floor.elevation for floor in elevator.floors()}
            self.cabins[name] = Cabin(elevator, heights)
            self._where[name] = (self.cabins[name].floor, Doors.CLOSED)
            for floor in heights:
                self._shut(name, floor)

    @property
    def time(self) -> float:
        """Of the simulation, s."""
        return self._steps * STEP_S

    # ---- robots ----

    def add(self, description: Description) -> Robot:
        """Let a robot stand where it says. Raises UnknownFloor, PlaceTaken; its name must be free."""
        floor, x, y, heading = description.pose
        if floor not in self.floors:
            raise UnknownFloor("pose", floor, list(self.floors))
        blocker = self.floors[floor].touching(x, y, description.radius_m)
        if blocker is not None:
            raise PlaceTaken(floor, x, y, blocker)
        robot = self.robots[description.name] = Robot(description)
        self._add_robot(robot, (x, y, heading))
        return robot

    def remove(self, name: str) -> None:
        """Take a robot away, with its rides and what it held. Raises UnknownRobot."""
        self.floors[self._robot(name).floor].remove(_body(name))
        del self.robots[name]
        for cabin in self.cabins.values():
            if name in cabin.sessions:
                cabin.give_up(name)

    def command(self, name: str, velocity: tuple[float, float, float], valid_s: float) -> None:
        """Move ahead, to the left (m/s) and turn (rad/s) for `valid_s`, unless told again. Raises UnknownRobot."""
        self.floors[self._robot(name).floor].command(_body(name), velocity, valid_s)

    def pose(self, name: str) -> Pose:
        """Where a robot is. Raises UnknownRobot."""
        floor = self._robot(name).floor
        return Pose(floor, *self.floors[floor].row(_body(name))[:3])

    def call_elevator(self, name: str, elevator: str, destination: str) -> None:
        """Reserve a ride from the floor where a robot is. Raises UnknownRobot, UnknownElement, InvalidRide,
        ElevatorFull."""
        robot = self._robot(name)
        if elevator not in self.cabins:
            raise UnknownElement("elevator", "", elevator)
        self.cabins[elevator].call(name, robot.floor, destination, robot.description.radius_m)

    # ---- time ----

    def step(self) -> list[Happening]:
        """Let STEP_S pass; what happened."""
        self._steps += 1
        happened = []
        for name, floor in self.floors.items():
            step = floor.step()
            for contact in step.contacts:
                who = tuple(_owner(body) for body in contact if body)
                happened.append(Happening(self.time, name, "collision", who))
            happened += [Happening(self.time, name, "grip lost", (_owner(robot),)) for robot in step.lost]
        for name, cabin in self.cabins.items():
            if cabin.sessions:
                self._see_who_moved(name, cabin)
            cabin.advance(STEP_S)
            self._follow(name, cabin)
            happened += [Happening(self.time, cabin.floor, "ride lost", (who,), why) for who, why in cabin.ended]
            cabin.ended.clear()
        return happened

    def _see_who_moved(self, name: str, cabin: Cabin) -> None:
        """A robot that stands in the cabin has entered; one that is clear of it has left."""
        shaft = shaft_polygon(self.building.elevators[name])
        for session in list(cabin.sessions.values()):
            if session.phase not in (Phase.BOARDING, Phase.ALIGHTING):
                continue
            pose = self.pose(session.robot)
            inside = shaft.exterior.distance(shapely.Point(pose.x, pose.y))
            is_in = shaft.contains(shapely.Point(pose.x, pose.y))
            if session.phase is Phase.BOARDING and is_in and inside >= session.radius_m:
                cabin.enter(session.robot)
            elif session.phase is Phase.ALIGHTING and not is_in and inside >= session.radius_m:
                cabin.leave(session.robot)

    def _follow(self, name: str, cabin: Cabin) -> None:
        """Open and close the landing doors, and take along who is inside."""
        before, doors = self._where[name]
        if (cabin.floor, cabin.doors) == (before, doors):
            return
        self._where[name] = (cabin.floor, cabin.doors)
        if cabin.floor != before:
            self._move(name, before, cabin.floor)
        if cabin.doors is Doors.OPEN:
            self.floors[cabin.floor].open(f"landing/{name}")
        elif doors is Doors.OPEN:
            self._shut(name, before)

    def _move(self, elevator: str, origin: str, destination: str) -> None:
        shaft = shaft_polygon(self.building.elevators[elevator])
        for body, row in self.floors[origin].state().items():
            if not shaft.contains(shapely.Point(row[0], row[1])):
                continue
            self.floors[origin].remove(body)
            kind, _, name = body.partition("/")
            if kind == "robot":
                self.robots[name].floor = destination
                self._add_robot(self.robots[name], row[:3])
            else:
                self._add_object(self.objects[name][0], destination, row[:3])

    def _shut(self, elevator: str, floor: str) -> None:
        shape = self.building.elevators[elevator]
        lines = [landing_line(shape, door) for door in shape.doors if door.floor == floor]
        self.floors[floor].shut(f"landing/{elevator}", shapely.multilinestrings(lines))

    # ---- bodies ----

    def _robot(self, name: str) -> Robot:
        if name not in self.robots:
            raise UnknownRobot(name)
        return self.robots[name]

    def _add_robot(self, robot: Robot, pose: tuple[float, ...]) -> None:
        about = robot.description
        self.floors[robot.floor].add_robot(
            _body(about.name), (pose[0], pose[1], pose[2]), about.radius_m, about.mass_kg, about.limits
        )

    def _add_object(self, thing: MapObject, floor: str, pose: tuple[float, ...]) -> None:
        outline = _outline(thing)
        self.objects[thing.name] = (thing, floor)
        mass = KG_A_SQUARE_METRE * outline.area
        self.floors[floor].add_object(f"object/{thing.name}", (pose[0], pose[1], pose[2]), outline, mass)


def standing(building: Building, floor: str) -> list[BaseGeometry]:
    """What blocks on a floor and does not move."""
    things = building.floors[floor].geometrical.objects
    return [
        item.geometry
        for item in obstacles(building, floor)
        if item.kind != "object" or not _is_movable(things[item.name])
    ]


def movable(building: Building, floor: str) -> Iterator[MapObject]:
    """Objects that can be pushed and carried."""
    return filter(_is_movable, building.floors[floor].geometrical.objects.values())


def _is_movable(thing: MapObject) -> bool:
    return thing.movable and not isinstance(thing.shape, SegmentShape)  # a line has no mass


def _outline(thing: MapObject) -> Polygon:
    """In the object's own frame."""
    turned = shapely.affinity.translate(object_geometry(thing), -thing.at[0], -thing.at[1])
    return shapely.affinity.rotate(turned, -thing.heading, (0, 0), use_radians=True)


def _body(robot: str) -> str:
    return f"robot/{robot}"


def _owner(body: str) -> str:
    return body.partition("/")[2]
