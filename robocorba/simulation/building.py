"""The simulated building: floors with their physics, elevators between them, and simulated time.

Every robot and object belongs to one floor. A cabin moves all bodies within its shaft; these belong to the floor where
the ride begins until the cabin arrives.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import shapely
from shapely.geometry.base import BaseGeometry

from robocorba.errors.paths import UnknownFloor
from robocorba.errors.simulation import (
    CannotGrip,
    InvalidChoice,
    InvalidCommand,
    InvalidRide,
    PlaceTaken,
    UnknownBody,
    UnknownRobot,
)
from robocorba.maps.geometry import shaft_polygon
from robocorba.maps.model import Building, Elevator, MapObject
from robocorba.maps.movable import fixed_obstacles, landing_doors, movables, object_outline
from robocorba.simulation.elevator import Cabin, Doorway, RidePhase, RideStatus
from robocorba.simulation.elevator_wait import longest_wait_s
from robocorba.simulation.floor_pool import FloorPool
from robocorba.simulation.physics import STEP_S, FloorPhysics
from robocorba.simulation.registry import Description
from robocorba.simulation.reservations import AreaRequest, Reservations
from robocorba.simulation.static_parts import static_parts
from robocorba.simulation.world_record import RobotRecord, WorldRecord
from robocorba.spatial.elevator_state import Doors, ElevatorState
from robocorba.spatial.floor_update import Body, BodyKind
from robocorba.spatial.frames import out_of
from robocorba.spatial.pose import Pose, RobotMotion
from robocorba.spatial.posture import Posture

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
#: Maximum validity of a velocity command [s].
MAX_VALID_S = 5.0
#: Field of the InvalidCommand for a robot that is held by an emergency stop.
STOPPED = "stopped"
#: Maximum number of joints in a reported posture.
MAX_JOINTS = 64
#: Bounds of the coordinates [m] and the heading [rad] of a pose at which a body is placed.
MAX_COORDINATE_M, MAX_HEADING = 1e6, 1e3
#: The body that a robot holds, and the grip point on the floor [m].
Held = tuple[str, tuple[float, float]]


class SimulatedRobot:
    """A robot in the building. Its methods and `holding` are thread-safe."""

    __slots__ = (
        *("_held", "_last", "body", "collisions", "description", "floor", "number", "physics", "posture"),
        *("stop_reason", "touched"),
    )

    def __init__(self, description: Description, number: int, floor: str, physics: FloorPhysics) -> None:
        self.description, self.number = description, number
        self.body = _robot_body(description.name)
        self.floor, self.physics = floor, physics
        self.collisions = 0
        #: Name of the robot or object of the last collision; empty for a static obstacle.
        self.touched = ""
        #: Why an emergency stop holds the robot; empty if none does.
        self.stop_reason = ""
        #: The posture that the robot reported last; None before the first one.
        self.posture: Posture | None = None
        self._last, self._held = RobotMotion(physics.time, description.pose, (0.0, 0.0, 0.0)), ""

    @property
    def name(self) -> str:
        return self.description.name

    def command(self, ahead: float, left: float, turn: float, valid_s: float) -> None:
        """Set the velocity [m/s, rad/s] for `valid_s` of simulated time or until the next command.

        Raises InvalidCommand."""
        if not math.isfinite(ahead + left + turn):
            raise InvalidCommand("wanted", f"({ahead}, {left}, {turn}) is not a velocity")
        if not 0.0 <= valid_s <= MAX_VALID_S:
            raise InvalidCommand("validFor", f"{valid_s} is not 0 to {MAX_VALID_S:g} s")
        if self.stop_reason:
            raise InvalidCommand(STOPPED, self.stop_reason)
        self.physics.command(self.body, ahead, left, turn, valid_s)
        if self.stop_reason:  # the robot was stopped meanwhile, perhaps before this command
            self.physics.brake(self.body)

    def brake(self) -> None:
        """Stop as fast as ground friction allows, until the next command."""
        self.physics.brake(self.body)

    def emergency_stop(self, reason: str) -> None:
        """Stop as `brake`, and refuse commands until `reset_stop`."""
        self.stop_reason = self.stop_reason or reason or "emergency stop"
        self.physics.brake(self.body)

    def reset_stop(self) -> None:
        """Accept commands again."""
        self.stop_reason = ""

    def report_posture(self, joints: Sequence[float]) -> None:
        """Keep the robot's joint angles [rad] for readers; no effect on the simulation. Raises InvalidCommand."""
        if len(joints) > MAX_JOINTS:
            raise InvalidCommand("joints", f"{len(joints)} angles; at most {MAX_JOINTS}")
        if not all(map(math.isfinite, joints)):
            raise InvalidCommand("joints", "an angle is not a finite number")
        self.posture = Posture(self.name, self.physics.time, tuple(joints))

    @property
    def holding(self) -> str:
        """Name of the held object after the last step; empty for none."""
        snapshot = self.physics.snapshot
        if self.body in snapshot.row_of:  # else it was just added or is changing floors
            self._held = _owner(snapshot.held.get(self.body, ""))
        return self._held

    def state(self) -> RobotMotion:
        """Pose and velocity after the last step."""
        snapshot = self.physics.snapshot
        row = snapshot.row_of.get(self.body)
        if row is not None:  # else it was just added or is changing floors
            self._last = snapshot.states[row]
        return self._last


class SimulationEvent(NamedTuple):
    """An event of the simulation; its fields are the published payload.

    kind: "collision", "grip lost", "boarding", "ride lost", "reservation over" or "placed". who: names of the robots
    and objects involved. waited_s, longest_wait_s: of a robot that may board, since its call, and the upper bound of
    that time when it called; None for other events."""

    time: float
    floor: str
    kind: str
    who: tuple[str, ...]
    reason: str = ""
    waited_s: float | None = None
    longest_wait_s: float | None = None


class SimulatedBuilding:
    """Simulation of `building`; movable objects start at their poses on the map. pool: steps the floors.

    One thread may use it; methods marked as thread-safe and SimulatedRobot are exceptions."""

    def __init__(self, building: Building, pool: FloorPool | None = None) -> None:
        self.pool = pool or FloorPool()
        self.building = Building(building.name)
        self.robots: dict[str, SimulatedRobot] = {}
        self.floors: dict[str, FloorPhysics] = {}
        self.cabins: dict[str, Cabin] = {}
        #: State of the elevators after the last step, by name.
        self.elevator_states: Mapping[str, ElevatorState] = {}
        #: Rides after the last step, by robot.
        self.rides: Mapping[str, RideStatus] = {}
        #: Movable objects by name: the object on the map, and its current floor.
        self.objects: dict[str, tuple[MapObject, str]] = {}
        #: Published bodies of robots and objects, by the name of the physical body.
        self.bodies: dict[str, Body] = {}
        #: Areas reserved by robots; reservations on a removed floor block nobody.
        self.reservations = Reservations()
        self._steps = self._numbers = 0
        self._last_cabins: dict[str, tuple[str, Doors]] = {}
        self._shafts: dict[str, shapely.Polygon] = {}
        #: Lines of closed doors, by elevator and floor.
        self._landings: dict[tuple[str, str], BaseGeometry] = {}
        self._idle: set[str] = set()
        #: The building for which obstacles have been changed already, and the physics of its new floors.
        self._prepared: tuple[Building | None, dict[str, FloorPhysics]] = (None, {})
        self.update(building)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._steps * STEP_S

    # ---- the map ----

    def preparations(self, building: Building) -> Iterator[Callable[[], None]]:
        """Calls that make most of the work of `update`, each within milliseconds: the simulation goes on between them,
        and obstacles appear one after the other. Any thread may ask for the next one while no other updates the map."""
        for name, physics in self.floors.items():
            if name in building.floors and self._obstacles_differ(building, self.building, name):
                for change in physics.changes_to(static_parts(fixed_obstacles(building, name))):
                    yield partial(physics.change_obstacles, change)
        added = {
            name: FloorPhysics(fixed_obstacles(building, name), 0, name)
            for name in building.floors.keys() - self.floors
        }
        self._prepared = building, added

    def _obstacles_differ(self, building: Building, before: Building, floor: str) -> bool:
        return building.floors[floor] is not before.floors.get(floor) or (
            building.elevators_through(floor) != before.elevators_through(floor)
        )

    def update(self, building: Building) -> list[str]:
        """Use an edited map; return the names of the robots that were removed with their floors.

        Objects that the edit did not change keep their simulated poses. Rides of a changed elevator are lost."""
        before, self.building = self.building, building
        (prepared_for, prepared), self._prepared = self._prepared, (None, {})
        removed = [robot.name for robot in self.robots.values() if robot.floor not in building.floors]
        for robot in removed:
            self.remove(robot)
        for name, (_, floor) in list(self.objects.items()):
            if floor not in building.floors:
                self._remove_object(name)
        floors = {**(prepared if prepared_for is building else {}), **self.floors}
        for name in building.floors.keys() - self.floors:
            floors.setdefault(name, FloorPhysics((), self._steps, name)).set_steps(self._steps)
        self.floors = {name: floors[name] for name in building.floors}
        for name in building.floors if prepared_for is not building else ():
            if self._obstacles_differ(building, before, name):
                self.floors[name].set_obstacles(fixed_obstacles(building, name))
        self._update_objects(before)
        for name in [name for name in self.cabins if building.elevators.get(name) != before.elevators[name]]:
            self._remove_cabin(name, before.elevators[name])
        for name, elevator in building.elevators.items():
            heights = {floor: building.floors[floor].floor.elevation for floor in elevator.floors()}
            if name not in self.cabins or self.cabins[name].heights != heights:
                self._add_cabin(name, Cabin(elevator, heights, self.time, partial(self._doorway, name)))
        self.refresh()
        return removed

    def _update_objects(self, before: Building) -> None:
        objects_before, objects = movables(before), movables(self.building)
        for name in [name for name in self.objects if objects.get(name) != objects_before[name]]:
            self._remove_object(name)
        for name, (map_object, floor) in objects.items():
            if name not in self.objects:
                self._add_object(name, map_object, floor)

    def _add_cabin(self, name: str, cabin: Cabin) -> None:
        self.cabins[name] = cabin
        self._shafts[name] = shaft_polygon(cabin.elevator)
        self._last_cabins[name] = (cabin.floor, Doors.CLOSED)
        for floor in cabin.heights:
            landing = self._landings[name, floor] = landing_doors(self.building, name, floor)
            is_kept_open = self.floors[floor].is_crossed(landing) or self._is_anything_left(name, floor)
            if is_kept_open and cabin.doors is not Doors.OPEN:
                cabin.start_open(floor)
                self._last_cabins[name] = (floor, Doors.OPEN)
            else:
                self._close_landing(name, floor)

    def _remove_cabin(self, name: str, elevator: Elevator) -> None:
        for floor in elevator.floors():
            self._landings.pop((name, floor), None)
            if floor in self.floors:
                self.floors[floor].open_door(f"landing/{name}")
        del self.cabins[name], self._last_cabins[name], self._shafts[name]

    # ---- robots ----

    def add(self, description: Description) -> SimulatedRobot:
        """Add a robot at the pose of its description; its name must be free. Raises UnknownFloor, PlaceTaken."""
        floor, x, y, _ = description.pose
        if floor not in self.floors:
            raise UnknownFloor("start", floor, list(self.floors))
        blocker = self.floors[floor].touching(x, y, description.radius_m)
        if blocker is not None:
            raise PlaceTaken(floor, x, y, _owner(blocker))
        return self._add_new(description, description.pose)

    def remove(self, name: str) -> None:
        """Remove a robot with its ride, grip and reservation. Raises UnknownRobot."""
        robot = self._robot(name)
        robot.physics.remove(robot.body)
        del self.robots[name], self.bodies[robot.body]
        self.cancel_elevator(name)
        self.reservations.release(name)

    def fall_silent(self, name: str) -> None:
        """A robot is about to be removed since it fell silent. What it has reserved is kept for a while if it holds an
        object, which others may hold, too."""
        if self.held_by(name):
            self.reservations.fall_silent(name)

    def pose(self, name: str) -> Pose:
        """Current pose of a robot. Raises UnknownRobot."""
        robot = self._robot(name)
        return Pose(robot.floor, *robot.physics.pose(robot.body))

    def place(self, name: str, pose: Pose) -> list[SimulationEvent]:
        """Put a robot or a movable object at a pose, at rest; grips of it and by it are released. Returns the events.

        A ride and a reservation of the robot stay. Raises UnknownBody, UnknownFloor, PlaceTaken, InvalidChoice."""
        floor, x, y, heading = pose
        for field, value, limit in (
            ("x", x, MAX_COORDINATE_M),
            ("y", y, MAX_COORDINATE_M),
            ("heading", heading, MAX_HEADING),
        ):
            if not abs(value) <= limit:  # also refuses NaN
                raise InvalidChoice(f"at.{field}", f"{value} is not a number between -{limit:g} and {limit:g}")
        robot, map_object = self.robots.get(name), self.objects.get(name, (None, ""))[0]
        if robot is None and map_object is None:
            raise UnknownBody(name)
        if floor not in self.floors:
            raise UnknownFloor("at.floor", floor[:200], list(self.floors))
        body = robot.body if robot else _object_body(name)
        if robot:
            blocker = self.floors[floor].touching(x, y, robot.description.radius_m, body)
        else:
            assert map_object
            blocker = self.floors[floor].overlapping(object_outline(map_object), pose[1:], body)
        if blocker is not None:
            raise PlaceTaken(floor, x, y, _owner(blocker))
        events = [
            SimulationEvent(self.time, holder.floor, "grip lost", (holder.name,), f"{name} was placed elsewhere")
            for holder in self.robots.values()
            if (held := holder.physics.held(holder.body)) and body in (holder.body, held[0])
        ]
        if robot:
            robot.physics.remove(body)
            self._place_robot(robot, floor, pose[1:])
        else:
            assert map_object
            self.floors[self.objects[name][1]].remove(body)
            self._place_object(name, map_object, floor, pose[1:])
        self._look_into_cabins()
        return [*events, SimulationEvent(self.time, floor, "placed", (name,))]

    def grip(self, name: str, object_name: str, at: tuple[float, float]) -> None:
        """Grip an object at the point `at` [m]. Raises UnknownRobot, CannotGrip."""
        robot = self._robot(name)
        if object_name not in self.objects or self.objects[object_name][1] != robot.floor:
            raise CannotGrip(object_name, f"there is no such movable object on {robot.floor}")
        if not math.isfinite(at[0] + at[1]):
            raise CannotGrip(object_name, f"({at[0]}, {at[1]}) is not a finite point")
        x, y, _ = robot.physics.pose(robot.body)
        point = f"({at[0]:g}, {at[1]:g})"
        distance_m = math.hypot(at[0] - x, at[1] - y)
        if distance_m > MAX_REACH_M:
            raise CannotGrip(object_name, f"{point} is {distance_m:.2f} m away; hands reach {MAX_REACH_M:g} m")
        gap_m = robot.physics.distance(_object_body(object_name), at)
        if gap_m > MAX_GRIP_DISTANCE_M:
            reason = f"{point} is {gap_m:.2f} m off its outline; at most {MAX_GRIP_DISTANCE_M:g} m"
            raise CannotGrip(object_name, reason)
        robot.physics.grip(robot.body, _object_body(object_name), at, MAX_GRIP_FORCE_N, PAYLOAD_KG)
        robot.physics.refresh()

    def held_by(self, name: str) -> Held | None:
        """What a robot holds, for `hold_again`. Raises UnknownRobot."""
        robot = self._robot(name)
        return robot.physics.held(robot.body)

    def hold_again(self, name: str, held: Held | None) -> None:
        """Undo a grip: hold what `held_by` has returned before. Raises UnknownRobot."""
        robot = self._robot(name)
        robot.physics.release(robot.body)
        if held:
            robot.physics.grip(robot.body, *held, MAX_GRIP_FORCE_N, PAYLOAD_KG)
        robot.physics.refresh()

    def release(self, name: str) -> None:
        """Release the held object, if any. Raises UnknownRobot."""
        robot = self._robot(name)
        robot.physics.release(robot.body)
        robot.physics.refresh()

    def call_elevator(
        self, name: str, elevator: str, destination: str, party: str = "", size: int = 1, boarding_s: float = 0.0
    ) -> None:
        """Call an elevator to the robot's floor, for one robot or as a member of a party of `size` robots, which needs
        `boarding_s` to drive in, and to drive out; 0 if that is unknown.

        Raises UnknownRobot, InvalidRide, ElevatorFull."""
        robot = self._robot(name)
        if elevator not in self.cabins:
            raise InvalidRide("elevator", f"there is no {elevator[:80]!r}")
        called = next((other for other, cabin in self.cabins.items() if name in cabin.sessions), None)
        if called:
            raise InvalidRide("elevator", f"{name} has already called {called}")
        cabin, radius_m = self.cabins[elevator], robot.description.radius_m
        session = cabin.call(name, robot.floor, destination, radius_m, party, size, boarding_s)
        session.longest_wait_s = longest_wait_s(cabin, name)
        self._update_elevator_states()

    def longest_elevator_wait_s(self, name: str) -> float:
        """Upper bound of the simulated time until the doors open for a robot's ride [s]; 0 without one."""
        return max((longest_wait_s(cabin, name) for cabin in list(self.cabins.values())), default=0.0)

    def cancel_elevator(self, name: str) -> None:
        """Cancel the robot's ride, if any."""
        for cabin in self.cabins.values():
            if name in cabin.sessions:
                cabin.cancel(name)
        self._update_elevator_states()

    def reserve(self, name: str, alternatives: Sequence[AreaRequest]) -> int:
        """Request one of several alternatives for a robot; return its index. Raises UnknownRobot, InvalidReservation,
        ReservationsFull."""
        self._robot(name)
        return self.reservations.reserve(name, alternatives)

    # ---- time ----

    def step(self) -> list[SimulationEvent]:
        """Advance time by STEP_S; return the events."""
        self._steps += 1
        events = []
        results = self.pool.step(list(self.floors.values()))
        for name, (contacts, lost) in zip(self.floors, results, strict=True):
            for first, second in contacts:
                self._count_collision(first, second)
                self._count_collision(second, first)
                bodies = tuple(_owner(body) for body in (first, second) if body)
                events.append(SimulationEvent(self.time, name, "collision", bodies))
            for robot in lost:
                events.append(SimulationEvent(self.time, name, "grip lost", (_owner(robot),)))
        for name, cabin in self.cabins.items():
            if cabin.sessions:
                self._detect_entry_and_exit(name, cabin)
            cabin.advance(STEP_S)
            self._apply_cabin_state(name, cabin)
            for rider, reason in cabin.ended:
                events.append(SimulationEvent(self.time, cabin.floor, "ride lost", (rider,), reason))
            cabin.ended.clear()
            for session in cabin.boarding:
                waited = self.time - session.called_at, session.longest_wait_s
                events.append(SimulationEvent(self.time, session.origin, "boarding", (session.robot,), "", *waited))
            cabin.boarding.clear()
        for ended in self.reservations.advance(self.time):
            silent = ended.kept_until is not None
            reason = "the robot fell silent" if silent else f"its limit of {ended.limit_s:g} s is over"
            events.append(SimulationEvent(self.time, ended.areas[0][0], "reservation over", (ended.owner,), reason))
        self._update_elevator_states()
        return events

    def close(self) -> None:
        """End the threads that step floors."""
        self.pool.close()

    def refresh(self) -> None:
        """Update the published state after bodies or calls changed, also while time is paused."""
        for floor in self.floors.values():
            floor.refresh()
        self._update_elevator_states()

    def _look_into_cabins(self) -> None:
        """As `refresh`, after bodies were placed: an idle cabin opens if an object is in it."""
        self._idle = set()
        self.refresh()

    def elevator_states_on(self, floor: str) -> dict[str, ElevatorState]:
        """State of the elevators that serve a floor, by name. Thread-safe."""
        served = self.building.elevators
        return {
            name: state
            for name, state in self.elevator_states.items()
            if name in served and floor in served[name].floors()
        }

    def _update_elevator_states(self) -> None:
        """Replace both maps as a whole, for readers in other threads; skip this while all elevators stay idle."""
        idle = {name for name, cabin in self.cabins.items() if cabin.is_idle}
        if len(self.elevator_states) == len(self.cabins) == len(idle) and idle == self._idle:
            return
        for name in idle - self._idle:
            if self._is_anything_left(name, self.cabins[name].floor):
                self.cabins[name].open()
                idle.remove(name)
        self._idle = idle
        self.elevator_states = {name: cabin.state() for name, cabin in self.cabins.items()}
        self.rides = {robot: ride for cabin in self.cabins.values() for robot, ride in cabin.rides().items()}

    def _count_collision(self, body: str, other: str) -> None:
        robot = self.robots.get(_owner(body)) if body.startswith(_ROBOT) else None
        if robot:
            robot.collisions += 1
            robot.touched = _owner(other)

    def _detect_entry_and_exit(self, name: str, cabin: Cabin) -> None:
        """Advance the rides of robots that are completely inside or completely outside the cabin, with what they
        hold."""
        shaft = self._shafts[name]
        for session in list(cabin.sessions.values()):
            if session.phase not in (RidePhase.BOARDING, RidePhase.ALIGHTING):
                continue
            pose = self.pose(session.robot)
            centre = shapely.Point(pose.x, pose.y)
            if shaft.exterior.distance(centre) < session.radius_m:
                continue  # partly inside
            held = self._held_outline(session.robot)
            if shaft.contains(centre):
                is_inside = session.phase is RidePhase.BOARDING and (held is None or shaft.contains(held))
                if is_inside and not self._has_stranger(name, cabin, session.party):
                    cabin.enter(session.robot)
            elif session.phase is RidePhase.ALIGHTING and (held is None or not shaft.intersects(held)):
                cabin.leave(session.robot)

    def _held_outline(self, name: str) -> shapely.Polygon | None:
        """The outline of what a robot holds, on its floor [m]."""
        robot = self.robots[name]
        held = robot.physics.held(robot.body)
        if held is None:
            return None
        pose = robot.physics.pose(held[0])
        return shapely.Polygon([out_of(x, y, pose) for x, y in self.bodies[held[0]].outline])

    def _has_stranger(self, name: str, cabin: Cabin, party: str) -> bool:
        """Whether a robot that is not of the party is in the cabin; False without a party."""
        if not party:
            return False
        of_party = {_robot_body(session.robot) for session in cabin.sessions.values() if session.party == party}
        return any(body.startswith(_ROBOT) and body not in of_party for body in self._bodies_inside(name, cabin.floor))

    def _bodies_inside(self, elevator: str, floor: str) -> list[str]:
        """Names of the bodies within an elevator's shaft on a floor."""
        rows = self.floors[floor].state()
        shaft = self._shafts[elevator]
        return [body for body, row in rows.items() if shaft.contains(shapely.Point(row[0], row[1]))]

    def _apply_cabin_state(self, name: str, cabin: Cabin) -> None:
        """Open and close landing doors by the cabin's state; move the bodies in it when it changes floors."""
        before, doors = self._last_cabins[name]
        if (cabin.floor, cabin.doors) == (before, doors):
            return
        self._last_cabins[name] = (cabin.floor, cabin.doors)
        if cabin.floor != before:
            self._transfer(name, before, cabin.floor)
        if cabin.doors is Doors.OPEN:
            self.floors[cabin.floor].open_door(f"landing/{name}")
        elif doors is Doors.OPEN:
            self._close_landing(name, before)

    def _transfer(self, elevator: str, origin: str, destination: str) -> None:
        """Move all bodies in the cabin to another floor, and restore their grips there."""
        before, after = self.floors[origin], self.floors[destination]
        inside = self._bodies_inside(elevator, origin)
        poses = {body: before.pose(body) for body in inside}
        grips = {body: held for body in inside if (held := before.held(body))}
        for body, pose in poses.items():
            before.remove(body)
            if body.startswith(_ROBOT):
                self._place_robot(self.robots[_owner(body)], destination, pose)
            else:
                self._place_object(_owner(body), self.objects[_owner(body)][0], destination, pose)
        for body, (held_body, at) in grips.items():
            if held_body in poses:
                after.grip(body, held_body, at, MAX_GRIP_FORCE_N, PAYLOAD_KG)

    def _doorway(self, elevator: str) -> Doorway:
        """What is between the open doors of an elevator."""
        floor = self.cabins[elevator].floor
        physics, landing = self.floors[floor], self._landings[elevator, floor]
        if physics.is_obstructed(landing) or self._is_anything_left(elevator, floor):
            return Doorway.OBSTRUCTED
        return Doorway.IN_USE if physics.is_crossed(landing) else Doorway.FREE

    def _is_anything_left(self, elevator: str, floor: str) -> bool:
        """Whether an object is within an elevator's shaft on a floor that no robot with a ride there holds."""
        objects = self.floors[floor].objects_within(self._shafts[elevator])
        riders = map(_robot_body, self.cabins[elevator].riders()) if objects else ()
        held = {grip[0] for rider in riders if (grip := self.floors[floor].held(rider))}
        return not held.issuperset(objects)

    def _close_landing(self, elevator: str, floor: str) -> None:
        self.floors[floor].close_door(f"landing/{elevator}", self._landings[elevator, floor])

    # ---- bodies ----

    def _robot(self, name: str) -> SimulatedRobot:
        if name not in self.robots:
            raise UnknownRobot(name)
        return self.robots[name]

    def _add_new(self, description: Description, pose: Pose) -> SimulatedRobot:
        robot = SimulatedRobot(description, self._number(), pose.floor, self.floors[pose.floor])
        self.robots[description.name] = robot
        self.bodies[robot.body] = Body(
            robot.number, BodyKind.ROBOT, robot.name, description.radius_m, (), description.mass_kg
        )
        self._place_robot(robot, pose.floor, pose[1:])
        return robot

    def _place_robot(self, robot: SimulatedRobot, floor: str, pose: tuple[float, float, float]) -> None:
        description = robot.description
        physics = self.floors[floor]
        physics.add_robot(robot.body, pose, description.radius_m, description.mass_kg, description.limits)
        robot.floor, robot.physics = floor, physics

    def _add_object(self, name: str, map_object: MapObject, floor: str) -> None:
        self._place_object(name, map_object, floor, (*map_object.at, map_object.heading))
        corners = list(object_outline(map_object).exterior.coords[:-1])
        radius_m = max(math.hypot(x, y) for x, y in corners)
        body = _object_body(name)
        mass_kg = self.floors[floor].mass_kg(body)
        self.bodies[body] = Body(self._number(), BodyKind.OBJECT, name, radius_m, tuple(corners), mass_kg)

    def _place_object(self, name: str, map_object: MapObject, floor: str, pose: tuple[float, float, float]) -> None:
        shape = object_outline(map_object)
        self.objects[name] = (map_object, floor)
        self.floors[floor].add_object(_object_body(name), pose, shape, KG_PER_SQUARE_METRE * shape.area)

    def _remove_object(self, name: str) -> None:
        _, floor = self.objects.pop(name)
        del self.bodies[_object_body(name)]
        if floor in self.floors:
            self.floors[floor].remove(_object_body(name))

    def _number(self) -> int:
        self._numbers += 1
        return self._numbers

    # ---- records ----

    def record(self) -> WorldRecord:
        """Everything that the map does not hold, for `restore`."""
        robots = {}
        for robot in self.robots.values():
            held = robot.physics.held(robot.body)
            grip = (_owner(held[0]), *held[1]) if held else None
            robots[robot.name] = RobotRecord(robot.floor, *robot.physics.pose(robot.body), grip, robot.collisions)
        objects = {
            name: (floor, *self.floors[floor].pose(_object_body(name))) for name, (_, floor) in self.objects.items()
        }
        cabins = {name: cabin.record() for name, cabin in self.cabins.items()}
        return WorldRecord(self._steps, robots, objects, cabins, reservations=self.reservations.record())

    def restore(self, world: WorldRecord, robots: list[Description]) -> None:
        """Restore a record with these robots in a new building; all bodies start at rest.

        Skips what the map no longer has. Robots that are not in the record get their start poses."""
        self._steps = world.steps
        for physics in self.floors.values():
            physics.set_steps(world.steps)
        for name, (floor, x, y, heading) in world.objects.items():
            if name in self.objects and floor in self.floors:
                map_object, before = self.objects[name]
                self.floors[before].remove(_object_body(name))
                self._place_object(name, map_object, floor, (x, y, heading))
        for description in robots:
            record = world.robots.get(description.name)
            pose = Pose(record.floor, record.x, record.y, record.heading) if record else description.pose
            if pose.floor not in self.floors:
                continue
            robot = self._add_new(description, pose)
            robot.collisions = record.collisions if record else 0
            if record and record.grip and self.objects.get(record.grip[0], (None, ""))[1] == pose.floor:
                held_name, x, y = record.grip
                robot.physics.grip(robot.body, _object_body(held_name), (x, y), MAX_GRIP_FORCE_N, PAYLOAD_KG)
        for name, cabin in self.cabins.items():
            if name in world.cabins and world.cabins[name].floor in cabin.heights:
                cabin.restore(world.cabins[name], self.time, self.robots.keys())
                for session in cabin.sessions.values():
                    session.longest_wait_s = self.time - session.called_at + longest_wait_s(cabin, session.robot)
                for floor in cabin.heights:
                    self._close_landing(name, floor)
                self._last_cabins[name] = (cabin.floor, Doors.CLOSED)
                self._apply_cabin_state(name, cabin)
            else:
                cabin.now = self.time
        self.reservations.restore(world.reservations, self.time, world.robots.keys() & self.robots.keys())
        self._look_into_cabins()


#: Prefix of the names of robots' bodies.
_ROBOT = "robot/"


def _robot_body(robot: str) -> str:
    return f"{_ROBOT}{robot}"


def _object_body(name: str) -> str:
    return f"object/{name}"


def _owner(body: str) -> str:
    """Name of the robot or object of a body."""
    return body.partition("/")[2]
