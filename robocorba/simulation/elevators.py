"""The elevators of the simulated building: cabins with the bodies in them, shafts, and landing doors.

A cabin moves all bodies within its shaft; these belong to the floor where the ride begins until the cabin arrives.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import count

import msgspec
import shapely
from shapely.geometry.base import BaseGeometry

from robocorba.errors.simulation import InvalidRide
from robocorba.map_editor.geometry import shaft_polygon
from robocorba.map_editor.lineage import Lineage
from robocorba.map_editor.model import Building, ElementKind, Elevator
from robocorba.map_editor.movable import landing_doors
from robocorba.map_editor.spatial.elevator_state import Doors, ElevatorState
from robocorba.simulation.body_names import is_robot, robot_body
from robocorba.simulation.elevator import Cabin, Doorway, RidePhase, RideStatus
from robocorba.simulation.elevator_wait import longest_wait_s
from robocorba.simulation.occupants import Occupants
from robocorba.simulation.physics import STEP_S
from robocorba.simulation.simulation_event import SimulationEvent
from robocorba.simulation.world_record import CabinRecord


class Elevators:
    """The elevators of a building with these robots and objects.

    One thread may use it; `states`, `rides` and `states_on` are exceptions."""

    def __init__(self, occupants: Occupants) -> None:
        self._occupants = occupants
        self.cabins: dict[str, Cabin] = {}
        #: States after the last step, by name. Replaced as a whole.
        self.states: Mapping[str, ElevatorState] = {}
        #: Rides after the last step, by robot. Replaced as a whole.
        self.rides: Mapping[str, RideStatus] = {}
        #: Those of the map.
        self._served: Mapping[str, Elevator] = {}
        self._shafts: dict[str, _Shaft] = {}
        self._idle: set[str] = set()
        self._numbers = count()

    def update(self, building: Building, now: float, lineage: Lineage, floors: Mapping[str, str]) -> None:
        """Use an edited map at a simulated time [s]. Rides of an elevator are lost if more than names have changed.

        lineage: which of its elevators are those of the present map. floors: names of its floors by their present
        ones."""
        before, self._served = self._served, building.elevators
        former_shafts, shafts = dict(self._shafts), {}
        #: New cabins, and the floors on which those of the former elevators are.
        changed: dict[str, tuple[Cabin, str]] = {}
        for name, elevator in building.elevators.items():
            origin = lineage.origin(ElementKind.ELEVATOR, "", name)
            former = origin.name if origin else ""
            heights = {floor: building.floors[floor].floor.elevation for floor in elevator.floors()}
            shaft = former_shafts.get(former)
            if (
                shaft
                and _renamed(before[former], name, floors) == elevator
                and shaft.cabin.heights_on(floors) == heights
            ):
                shafts[name] = former_shafts.pop(former)
                shaft.cabin.rename(elevator, floors)
                shaft.rename(floors)
            else:
                changed[name] = Cabin(elevator, heights, now), floors.get(shaft.cabin.floor, "") if shaft else ""
        for shaft in former_shafts.values():
            for floor in shaft.landings:
                if physics := self._occupants.floors.get(floors.get(floor, "")):
                    physics.open_door(shaft.door)
        for name, (cabin, former_floor) in changed.items():
            landings = {floor: landing_doors(building, name, floor) for floor in cabin.heights}
            polygon, last = shaft_polygon(cabin.elevator), (cabin.floor, Doors.CLOSED)
            shafts[name] = shaft = _Shaft(next(self._numbers), cabin, polygon, landings, last)
            cabin.doorway = partial(self._doorway, shaft)
            self._start(shaft, former_floor)
        self._shafts = shafts
        self.cabins = {name: shafts[name].cabin for name in building.elevators}

    def _start(self, shaft: _Shaft, former_floor: str = "") -> None:
        """Let a new cabin start open on a floor where something is in its doors or its shaft: the former floor if it is
        there, too."""
        cabin = shaft.cabin
        for floor in sorted(shaft.landings, key=lambda floor: floor != former_floor):
            if cabin.doors is not Doors.OPEN and self._is_in_use(shaft, floor):
                cabin.start_open(floor)
                shaft.last = (floor, Doors.OPEN)
                self._occupants.floors[floor].open_door(shaft.door)
            else:
                self._close_landing(shaft, floor)

    def _is_in_use(self, shaft: _Shaft, floor: str) -> bool:
        """Whether a body is in a shaft or its doorway on a floor."""
        is_crossed = self._occupants.floors[floor].is_crossed(shaft.landings[floor])
        return is_crossed or bool(self._occupants.within(shaft.polygon, floor))

    # ---- rides ----

    def call(
        self, name: str, elevator: str, destination: str, party: str = "", size: int = 1, boarding_s: float = 0.0
    ) -> None:
        """Call an elevator to a robot's floor, for one robot or as a member of a party of `size` robots, which needs
        `boarding_s` to drive in, and to drive out; 0 if that is unknown.

        Raises UnknownRobot, InvalidRide, ElevatorFull."""
        robot = self._occupants.robot(name)
        if elevator not in self.cabins:
            raise InvalidRide("elevator", f"there is no {elevator[:80]!r}")
        called = next((other for other, cabin in self.cabins.items() if name in cabin.sessions), None)
        if called:
            raise InvalidRide("elevator", f"{name} has already called {called}")
        cabin, radius_m = self.cabins[elevator], robot.description.radius_m
        session = cabin.call(name, robot.floor, destination, radius_m, party, size, boarding_s)
        session.longest_wait_s = longest_wait_s(cabin, name)
        self.refresh()

    def longest_wait_s(self, name: str) -> float:
        """Upper bound of the simulated time until the doors open for a robot's ride [s]; 0 without one."""
        return max((longest_wait_s(cabin, name) for cabin in list(self.cabins.values())), default=0.0)

    def cancel(self, name: str) -> None:
        """Cancel a robot's ride, if any."""
        for cabin in self.cabins.values():
            if name in cabin.sessions:
                cabin.cancel(name)
        self.refresh()

    # ---- time ----

    def step(self, now: float) -> list[SimulationEvent]:
        """Advance to `now` [s], by STEP_S; return the events."""
        events = []
        for name, cabin in self.cabins.items():
            if cabin.sessions:
                self._detect_entry_and_exit(name, cabin)
            cabin.advance(STEP_S)
            self._apply_cabin_state(name, cabin)
            for rider, reason in cabin.ended:
                events.append(SimulationEvent(now, cabin.floor, "ride lost", (rider,), reason))
            cabin.ended.clear()
            for session in cabin.boarding:
                waited = now - session.called_at, session.longest_wait_s
                events.append(SimulationEvent(now, session.origin, "boarding", (session.robot,), "", *waited))
            cabin.boarding.clear()
        self.refresh()
        return events

    def states_on(self, floor: str) -> dict[str, ElevatorState]:
        """States of the elevators that serve a floor, by name. Thread-safe."""
        served = self._served
        return {name: state for name, state in self.states.items() if name in served and floor in served[name].floors()}

    def refresh(self, looks_into_cabins: bool = False) -> None:
        """Update `states` and `rides`; skips this while all elevators stay idle. A cabin that gets idle opens if an
        object is in it; looks_into_cabins: also others that are idle, since bodies or names have changed."""
        if looks_into_cabins:
            self._idle = set()
        idle = {name for name, cabin in self.cabins.items() if cabin.is_idle}
        if len(self.states) == len(self.cabins) == len(idle) and idle == self._idle:
            return
        for name in idle - self._idle:
            if self._is_anything_left(self._shafts[name]):
                self.cabins[name].open()
                idle.remove(name)
        self._idle = idle
        self.states = {name: cabin.state() for name, cabin in self.cabins.items()}
        self.rides = {robot: ride for cabin in self.cabins.values() for robot, ride in cabin.rides().items()}

    def _detect_entry_and_exit(self, name: str, cabin: Cabin) -> None:
        """Advance the rides of robots that are completely inside or completely outside the cabin, with what they
        hold."""
        shaft = self._shafts[name].polygon
        for session in list(cabin.sessions.values()):
            if session.phase not in (RidePhase.BOARDING, RidePhase.ALIGHTING):
                continue
            pose = self._occupants.pose(session.robot)
            centre = shapely.Point(pose.x, pose.y)
            if shaft.exterior.distance(centre) < session.radius_m:
                continue  # partly inside
            held = self._occupants.held_outline(session.robot)
            if shaft.contains(centre):
                is_inside = session.phase is RidePhase.BOARDING and (held is None or shaft.contains(held))
                if is_inside and not self._has_stranger(name, cabin, session.party):
                    cabin.enter(session.robot)
            elif session.phase is RidePhase.ALIGHTING and (held is None or not shaft.intersects(held)):
                cabin.leave(session.robot)

    def _has_stranger(self, name: str, cabin: Cabin, party: str) -> bool:
        """Whether a robot that is not of the party is in the cabin; False without a party."""
        if not party:
            return False
        of_party = {robot_body(session.robot) for session in cabin.sessions.values() if session.party == party}
        return any(
            is_robot(body) and body not in of_party
            for body in self._occupants.within(self._shafts[name].polygon, cabin.floor)
        )

    def _apply_cabin_state(self, name: str, cabin: Cabin) -> None:
        """Open and close landing doors by the cabin's state; move the bodies in it when it changes floors."""
        shaft = self._shafts[name]
        before, doors = shaft.last
        if (cabin.floor, cabin.doors) == (before, doors):
            return
        shaft.last = (cabin.floor, cabin.doors)
        if cabin.floor != before:
            self._occupants.exchange(shaft.polygon, before, cabin.floor)
        if cabin.doors is Doors.OPEN:
            self._occupants.floors[cabin.floor].open_door(shaft.door)
        elif doors is Doors.OPEN:
            self._close_landing(shaft, before)

    def _doorway(self, shaft: _Shaft) -> Doorway:
        """What is between the open doors of an elevator."""
        floor = shaft.cabin.floor
        physics, landing = self._occupants.floors[floor], shaft.landings[floor]
        if physics.is_obstructed(landing) or self._is_anything_left(shaft):
            return Doorway.OBSTRUCTED
        return Doorway.IN_USE if physics.is_crossed(landing) else Doorway.FREE

    def _is_anything_left(self, shaft: _Shaft) -> bool:
        """Whether an object that no robot with a ride there holds is within a shaft on the cabin's floor."""
        physics = self._occupants.floors[shaft.cabin.floor]
        objects = physics.objects_within(shaft.polygon)
        riders = map(robot_body, shaft.cabin.riders()) if objects else ()
        held = {grip[0] for rider in riders if (grip := physics.held(rider))}
        return not held.issuperset(objects)

    def _close_landing(self, shaft: _Shaft, floor: str) -> None:
        self._occupants.floors[floor].close_door(shaft.door, shaft.landings[floor])

    # ---- records ----

    def records(self) -> dict[str, CabinRecord]:
        """Cabins and rides, by elevator."""
        return {name: cabin.record() for name, cabin in self.cabins.items()}

    def restore(self, records: Mapping[str, CabinRecord], now: float, robots: Collection[str]) -> None:
        """Restore the rides of these robots at a simulated time [s]."""
        for name, cabin in self.cabins.items():
            if name in records and records[name].floor in cabin.heights:
                cabin.restore(records[name], now, robots)
                for session in cabin.sessions.values():
                    session.longest_wait_s = now - session.called_at + longest_wait_s(cabin, session.robot)
                shaft = self._shafts[name]
                for floor in cabin.heights:
                    self._close_landing(shaft, floor)
                shaft.last = (cabin.floor, Doors.CLOSED)
                self._apply_cabin_state(name, cabin)
            else:
                cabin.now = now
                self._start(self._shafts[name])


@dataclass
class _Shaft:
    """The shaft of an elevator. number: its identity while names change. landings: lines of its closed doors, by floor.
    last: floor and doors of the cabin, as they were applied last."""

    number: int
    cabin: Cabin
    polygon: shapely.Polygon
    landings: dict[str, BaseGeometry]
    last: tuple[str, Doors]

    @property
    def door(self) -> str:
        """Its door on a floor, for the physics."""
        return f"landing/{self.number}"

    def rename(self, floors: Mapping[str, str]) -> None:
        """Follow the names of floors, by their present ones."""
        self.landings = {floors[floor]: landing for floor, landing in self.landings.items()}
        self.last = (floors[self.last[0]], self.last[1])


def _renamed(elevator: Elevator, name: str, floors: Mapping[str, str]) -> Elevator:
    """An elevator with other names: its own, and those of floors by their present ones."""
    doors = tuple(msgspec.structs.replace(door, floor=floors.get(door.floor, "")) for door in elevator.doors)
    return msgspec.structs.replace(elevator, name=name, doors=doors)
