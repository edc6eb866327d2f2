"""The elevators of the simulated building: cabins with the bodies in them, shafts, and landing doors.

A cabin moves all bodies within its shaft; these belong to the floor where the ride begins until the cabin arrives.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import partial

import shapely
from shapely.geometry.base import BaseGeometry

from robocorba.errors.simulation import InvalidRide
from robocorba.maps.geometry import shaft_polygon
from robocorba.maps.model import Building, Elevator
from robocorba.maps.movable import landing_doors
from robocorba.simulation.body_names import is_robot, robot_body
from robocorba.simulation.elevator import Cabin, Doorway, RidePhase, RideStatus
from robocorba.simulation.elevator_wait import longest_wait_s
from robocorba.simulation.occupants import Occupants
from robocorba.simulation.physics import STEP_S
from robocorba.simulation.simulation_event import SimulationEvent
from robocorba.simulation.world_record import CabinRecord
from robocorba.spatial.elevator_state import Doors, ElevatorState


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
        self._last: dict[str, tuple[str, Doors]] = {}
        self._shafts: dict[str, shapely.Polygon] = {}
        #: Lines of closed doors, by elevator and floor.
        self._landings: dict[tuple[str, str], BaseGeometry] = {}
        self._idle: set[str] = set()

    def update(self, building: Building, now: float) -> None:
        """Use an edited map at a simulated time [s]. Rides of a changed elevator are lost."""
        before, self._served = self._served, building.elevators
        for name in [name for name in self.cabins if building.elevators.get(name) != before[name]]:
            self._remove(name, before[name])
        for name, elevator in building.elevators.items():
            heights = {floor: building.floors[floor].floor.elevation for floor in elevator.floors()}
            if name not in self.cabins or self.cabins[name].heights != heights:
                landings = {floor: landing_doors(building, name, floor) for floor in heights}
                self._add(name, Cabin(elevator, heights, now, partial(self._doorway, name)), landings)

    def _add(self, name: str, cabin: Cabin, landings: Mapping[str, BaseGeometry]) -> None:
        self.cabins[name] = cabin
        self._shafts[name] = shaft_polygon(cabin.elevator)
        self._last[name] = (cabin.floor, Doors.CLOSED)
        for floor, landing in landings.items():
            self._landings[name, floor] = landing
            is_kept_open = self._occupants.floors[floor].is_crossed(landing) or self._is_anything_left(name, floor)
            if is_kept_open and cabin.doors is not Doors.OPEN:
                cabin.start_open(floor)
                self._last[name] = (floor, Doors.OPEN)
            else:
                self._close_landing(name, floor)

    def _remove(self, name: str, elevator: Elevator) -> None:
        for floor in elevator.floors():
            self._landings.pop((name, floor), None)
            if floor in self._occupants.floors:
                self._occupants.floors[floor].open_door(f"landing/{name}")
        del self.cabins[name], self._last[name], self._shafts[name]

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

    def look_into_cabins(self) -> None:
        """As `refresh`, after bodies were placed: an idle cabin opens if an object is in it."""
        self._idle = set()
        self.refresh()

    def states_on(self, floor: str) -> dict[str, ElevatorState]:
        """States of the elevators that serve a floor, by name. Thread-safe."""
        served = self._served
        return {name: state for name, state in self.states.items() if name in served and floor in served[name].floors()}

    def refresh(self) -> None:
        """Update `states` and `rides`; skips this while all elevators stay idle."""
        idle = {name for name, cabin in self.cabins.items() if cabin.is_idle}
        if len(self.states) == len(self.cabins) == len(idle) and idle == self._idle:
            return
        for name in idle - self._idle:
            if self._is_anything_left(name, self.cabins[name].floor):
                self.cabins[name].open()
                idle.remove(name)
        self._idle = idle
        self.states = {name: cabin.state() for name, cabin in self.cabins.items()}
        self.rides = {robot: ride for cabin in self.cabins.values() for robot, ride in cabin.rides().items()}

    def _detect_entry_and_exit(self, name: str, cabin: Cabin) -> None:
        """Advance the rides of robots that are completely inside or completely outside the cabin, with what they
        hold."""
        shaft = self._shafts[name]
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
            is_robot(body) and body not in of_party for body in self._occupants.within(self._shafts[name], cabin.floor)
        )

    def _apply_cabin_state(self, name: str, cabin: Cabin) -> None:
        """Open and close landing doors by the cabin's state; move the bodies in it when it changes floors."""
        before, doors = self._last[name]
        if (cabin.floor, cabin.doors) == (before, doors):
            return
        self._last[name] = (cabin.floor, cabin.doors)
        if cabin.floor != before:
            self._occupants.transfer(self._occupants.within(self._shafts[name], before), before, cabin.floor)
        if cabin.doors is Doors.OPEN:
            self._occupants.floors[cabin.floor].open_door(f"landing/{name}")
        elif doors is Doors.OPEN:
            self._close_landing(name, before)

    def _doorway(self, elevator: str) -> Doorway:
        """What is between the open doors of an elevator."""
        floor = self.cabins[elevator].floor
        physics, landing = self._occupants.floors[floor], self._landings[elevator, floor]
        if physics.is_obstructed(landing) or self._is_anything_left(elevator, floor):
            return Doorway.OBSTRUCTED
        return Doorway.IN_USE if physics.is_crossed(landing) else Doorway.FREE

    def _is_anything_left(self, elevator: str, floor: str) -> bool:
        """Whether an object is within an elevator's shaft on a floor that no robot with a ride there holds."""
        objects = self._occupants.floors[floor].objects_within(self._shafts[elevator])
        riders = map(robot_body, self.cabins[elevator].riders()) if objects else ()
        held = {grip[0] for rider in riders if (grip := self._occupants.floors[floor].held(rider))}
        return not held.issuperset(objects)

    def _close_landing(self, elevator: str, floor: str) -> None:
        self._occupants.floors[floor].close_door(f"landing/{elevator}", self._landings[elevator, floor])

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
                for floor in cabin.heights:
                    self._close_landing(name, floor)
                self._last[name] = (cabin.floor, Doors.CLOSED)
                self._apply_cabin_state(name, cabin)
            else:
                cabin.now = now
