"""An elevator: robots call it, board, ride and alight; one session for each ride.

The cabin serves the oldest call, then the next one. En route it also stops for rides in the same direction that still
fit in. A robot that does not board or alight in time loses its session, and the doors close. So every wait is bounded,
unless something is between the doors: they never close on it. Those who wait on that floor board meanwhile, also if
others have called before. While an object obstructs the doors only parties do: they may carry it away, and a lone robot
in the cabin would keep them out.

Robots that ride together call as a party, and ride without others. All members board at the turn of its first call;
`queue` and `ahead` count single calls. The other members may call while the doors are open for the party; the doors
stay open until all are inside or the limit expires.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Container, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import NamedTuple

from robocorba.errors.simulation import ElevatorFull, InvalidRide, NoRide
from robocorba.map_editor.model import Elevator
from robocorba.map_editor.spatial.elevator_state import Doors, ElevatorState
from robocorba.planning.elevators import travel_time, travelled
from robocorba.simulation.world_record import CabinRecord, RideRecord

#: Time limit for boarding, and for alighting, while the doors are open [s].
BOARDING_LIMIT_S = 15.0
#: A party has its own estimate of this time plus a margin, if that is longer, up to a limit [s].
BOARDING_MARGIN_S, MAX_BOARDING_S = 5.0, 60.0
#: No robot starts boarding after the doors have been open for this time [s], since robots wait on other floors.
OPEN_LIMIT_S = 2 * BOARDING_LIMIT_S
#: Doors that have been kept from closing for this time count as just opened [s].
BLOCKED_S = 10.0
#: Maximum number of simultaneous sessions of an elevator, and of members of a party.
MAX_SESSIONS = 200
#: Maximum length of a party's name [characters].
MAX_PARTY_NAME = 200
#: Rounding tolerance of heights and widths [m].
_TOLERANCE_M = 1e-9


class RidePhase(Enum):
    """Phase of a ride, from call to alighting."""

    WAITING = 0
    BOARDING = 1
    RIDING = 2
    ALIGHTING = 3


_INSIDE = (RidePhase.RIDING, RidePhase.ALIGHTING)


class Doorway(Enum):
    """What is between open doors: nothing, a robot or what robots hold, or an object that nobody holds."""

    FREE = 0
    IN_USE = 1
    OBSTRUCTED = 2


@dataclass(eq=False)
class RideSession:
    """Session of one robot, from call to alighting.

    called_at: simulated time [s]. party: name of a party of `size` robots, empty for a lone robot. limit_s: time limit
    for boarding, and for alighting. since: simulated time at which boarding or alighting began [s]. longest_wait_s:
    upper bound of the time from the call until boarding, as it was when the robot called [s]."""

    robot: str
    origin: str
    destination: str
    radius_m: float
    called_at: float
    party: str = ""
    size: int = 1
    limit_s: float = BOARDING_LIMIT_S
    phase: RidePhase = RidePhase.WAITING
    since: float = 0.0
    longest_wait_s: float = 0.0

    def enter_phase(self, phase: RidePhase, now: float) -> None:
        self.phase, self.since = phase, now


class RideStatus(NamedTuple):
    """State of a ride as published to its robot. ahead: waiting robots that called before."""

    phase: RidePhase
    elevator: str
    origin: str
    destination: str
    ahead: int


class Cabin:
    """Simulated cabin; it starts at the lowest floor with closed doors. heights: of the served floors [m].
    doorway: what is between the open doors."""

    def __init__(
        self,
        elevator: Elevator,
        heights: dict[str, float],
        now: float = 0.0,
        doorway: Callable[[], Doorway] = lambda: Doorway.FREE,
    ) -> None:
        self.elevator, self.heights = elevator, heights
        self.doorway = doorway
        self.now = now
        self.doors = Doors.CLOSED
        self.floor = min(heights, key=lambda name: heights[name])
        #: Floor that the cabin travels to; empty while it is stopped.
        self._target = ""
        self._since = now
        #: Time at which a party began to board, and its limit [s].
        self._party_since, self._party_limit_s = now, BOARDING_LIMIT_S
        #: Time since which something keeps the doors from closing; infinite if nothing does.
        self._blocked_since = math.inf
        self.sessions: dict[str, RideSession] = {}
        #: Sessions whose robots may board since this list was cleared last.
        self.boarding: list[RideSession] = []
        #: Robot and reason of each session that the elevator ended, since the robot was too late.
        self.ended: list[tuple[str, str]] = []

    def heights_on(self, floors: Mapping[str, str]) -> dict[str, float]:
        """The heights of the served floors with other names of floors, by the present ones; without those that have
        none."""
        return {floors[floor]: height for floor, height in self.heights.items() if floor in floors}

    def rename(self, elevator: Elevator, floors: Mapping[str, str]) -> None:
        """Follow an edit of names: the elevator with its new ones, and those of all served floors, by the present
        ones."""
        self.elevator, self.heights = elevator, self.heights_on(floors)
        self.floor, self._target = floors[self.floor], floors.get(self._target, "")
        for session in self.sessions.values():
            session.origin, session.destination = floors[session.origin], floors[session.destination]

    def start_open(self, floor: str) -> None:
        """Start at a floor with open doors, since something is between them."""
        self.floor = floor
        self._set_doors(Doors.OPEN)

    def open(self) -> None:
        """Open the doors of an idle cabin, since something is in it that no robot rides with."""
        self._set_doors(Doors.OPENING)

    # ---- calls of robots ----

    def call(
        self,
        robot: str,
        origin: str,
        destination: str,
        radius_m: float,
        party: str = "",
        size: int = 1,
        boarding_s: float = 0.0,
    ) -> RideSession:
        """Request a ride for one robot, or for a member of a party of `size`, which needs `boarding_s` to drive in, and
        to drive out; 0 if that is unknown. Raises InvalidRide, ElevatorFull."""
        for field, floor in (("origin", origin), ("destination", destination)):
            if floor not in self.heights:
                raise InvalidRide(field, f"{self.elevator.name} does not serve {floor}")
        if origin == destination:
            raise InvalidRide("destination", f"{destination} is also the origin")
        if robot in self.sessions:
            raise InvalidRide("robot", f"{robot} has already called {self.elevator.name}")
        if not radius_m > 0.0 or not fits(self.elevator, [radius_m]):
            raise InvalidRide("radius", f"a robot of radius {radius_m} m does not fit into {self.elevator.name}")
        limit_s = BOARDING_LIMIT_S
        if party:
            self._check_party(party, size, origin, destination, radius_m)
            if not 0.0 <= boarding_s <= MAX_BOARDING_S - BOARDING_MARGIN_S:  # also refuses NaN
                raise InvalidRide("boardingTime", f"{boarding_s} s is not 0 to {MAX_BOARDING_S - BOARDING_MARGIN_S:g}")
            limit_s = max(BOARDING_LIMIT_S, boarding_s + BOARDING_MARGIN_S)
        if len(self.sessions) >= MAX_SESSIONS:
            raise ElevatorFull(self.elevator.name, MAX_SESSIONS)
        session = RideSession(robot, origin, destination, radius_m, self.now, party, size if party else 1, limit_s)
        self.sessions[robot] = session
        if party and self.doors is Doors.OPEN:
            self._start_alighting_and_boarding()
        return session

    def _check_party(self, party: str, size: int, origin: str, destination: str, radius_m: float) -> None:
        """Check that one more robot may join a party. Raises InvalidRide."""
        if len(party) > MAX_PARTY_NAME:
            raise InvalidRide("party", f"has {len(party)} characters; at most {MAX_PARTY_NAME}")
        if not 1 <= size <= MAX_SESSIONS:
            raise InvalidRide("partySize", f"{size} is not 1 to {MAX_SESSIONS}")
        others = self._party(party)
        radii = [radius_m] * (size - len(others)) + [other.radius_m for other in others]
        if radii and not fits(self.elevator, radii):
            raise InvalidRide(
                "partySize", f"{size} robots of radius {max(radii):g} m do not fit into {self.elevator.name}"
            )
        for other in others:
            if (other.origin, other.destination) != (origin, destination):
                raise InvalidRide("party", f"{party[:80]} rides from {other.origin} to {other.destination}")
            if other.size != size:
                raise InvalidRide("partySize", f"{size} differs from {other.size} in the call of {other.robot}")
        if len(others) >= size:
            raise InvalidRide("party", f"all {size} robots of {party[:80]} have called already")
        is_in_time = origin == self.floor and self._is_party_in_time()
        if any(other.phase in _INSIDE for other in others) and not is_in_time:
            raise InvalidRide("party", f"{party[:80]} has already departed")

    def enter(self, robot: str) -> None:
        """The robot is inside the cabin. Raises NoRide unless it is boarding."""
        self._session(robot, RidePhase.BOARDING).enter_phase(RidePhase.RIDING, self.now)

    def leave(self, robot: str) -> None:
        """The robot has left the cabin at its destination. Raises NoRide unless it is alighting."""
        self._session(robot, RidePhase.ALIGHTING)
        del self.sessions[robot]

    def cancel(self, robot: str, reason: str = "") -> None:
        """End a robot's ride in any phase; with a reason it is recorded in `ended`. Raises NoRide without a ride."""
        if robot not in self.sessions:
            raise NoRide(robot, self.elevator.name)
        del self.sessions[robot]
        self.boarding = [session for session in self.boarding if session.robot != robot]
        if reason:
            self.ended.append((robot, reason))

    def _session(self, robot: str, phase: RidePhase) -> RideSession:
        session = self.sessions.get(robot)
        if session is None or session.phase is not phase:
            raise NoRide(robot, self.elevator.name)
        return session

    # ---- records ----

    def record(self) -> CabinRecord:
        """Floor and sessions, for `restore`."""
        rides = []
        for s in self.sessions.values():
            trip = s.robot, s.origin, s.destination, s.radius_m, s.called_at
            rides.append(RideRecord(*trip, s.phase in _INSIDE, s.party, s.size, s.limit_s))
        return CabinRecord(self.floor, rides, self.doors is Doors.OPEN)

    def restore(self, record: CabinRecord, now: float, robots: Container[str]) -> None:
        """Restore a record with the rides of these robots. The cabin is stopped; doors that were not fully open are
        closed.

        They start opening immediately for a party of which some members are still outside."""
        self.floor, self.now = record.floor, now
        self._set_doors(Doors.CLOSED)
        for ride in record.rides:
            if ride.robot in robots and {ride.origin, ride.destination} <= self.heights.keys():
                trip = (ride.robot, ride.origin, ride.destination, ride.radius_m, ride.called_at)
                session = self.sessions[ride.robot] = RideSession(*trip, ride.party, ride.size, ride.limit_s)
                session.phase = RidePhase.RIDING if ride.inside else RidePhase.WAITING
        if waiting := [each for each in self.sessions.values() if self._waits_for_party_members(each)]:
            self._set_doors(Doors.OPENING)
            self._party_since = now + self.elevator.door_time
            self._party_limit_s = max(each.limit_s for each in waiting)
        if record.is_open:
            self._set_doors(Doors.OPEN)
            self._start_alighting_and_boarding()

    # ---- time ----

    def advance(self, seconds: float) -> None:
        """Advance time by `seconds`."""
        end = self.now + seconds
        if self.is_idle:
            self.now = end
        while self.now < end:
            stage_end = self._stage_end()
            if stage_end > end:
                self.now = end
                return
            self.now = max(self.now, stage_end)
            if not self._start_next_stage():
                self.now = end

    @property
    def is_idle(self) -> bool:
        """Whether the cabin is stopped with closed doors and has no sessions."""
        return not self.sessions and self.doors is Doors.CLOSED and not self._target

    def state(self) -> ElevatorState:
        """Current state for publication."""
        height, passed = self.heights[self.floor], self.now - self._since
        if self._target:
            height += travelled(self.elevator, self.heights[self._target] - height, passed)
        share = {Doors.CLOSED: 0.0, Doors.OPEN: 1.0}.get(self.doors)
        if share is None:
            share = min(1.0, passed / self.elevator.door_time) if self.elevator.door_time else 1.0
            share = share if self.doors is Doors.OPENING else 1.0 - share
        queue = tuple(s.robot for s in self.sessions.values() if s.phase is RidePhase.WAITING)
        return ElevatorState(height, "" if self._target else self.floor, self.doors, share, self.riders(), queue)

    def riders(self) -> tuple[str, ...]:
        """Names of the robots inside, from when they have boarded until they have alighted."""
        return tuple(s.robot for s in self.sessions.values() if s.phase in _INSIDE)

    def rides(self) -> dict[str, RideStatus]:
        """Status of all rides, by robot."""
        rides, ahead = {}, 0
        for session in self.sessions.values():
            is_waiting = session.phase is RidePhase.WAITING
            trip = (self.elevator.name, session.origin, session.destination)
            rides[session.robot] = RideStatus(session.phase, *trip, ahead if is_waiting else 0)
            ahead += is_waiting
        return rides

    def _stage_end(self) -> float:
        """Time at which the cabin's stage (doors, travel) ends; the current time if it may start another now."""
        if self._target:
            return self._since + travel_time(self.elevator, self.heights[self._target] - self.heights[self.floor])
        if self.doors in (Doors.OPENING, Doors.CLOSING):
            return self._since + self.elevator.door_time
        if self.doors is Doors.OPEN:
            waits = [s.since + s.limit_s for s in self._moving_through_doors()]
            if self._is_waiting_for_party():
                waits.append(self._party_since + self._party_limit_s)
            return min(waits, default=self.now)
        return self.now

    def _start_next_stage(self) -> bool:
        """Start the next stage of the cabin; return False if there is nothing to do."""
        if self._target:
            self.floor, self._target = self._target, ""
            self._set_doors(Doors.OPENING)
        elif self.doors is Doors.OPENING:
            self._set_doors(Doors.OPEN)
            self._start_alighting_and_boarding()
        elif self.doors is Doors.OPEN:
            for session in self._moving_through_doors():
                if self.now >= session.since + session.limit_s:
                    direction = "in" if session.phase is RidePhase.BOARDING else "out"
                    self.cancel(session.robot, f"did not drive {direction} within {session.limit_s:g} s")
            if not self._start_alighting_and_boarding():
                if self.doorway() is not Doorway.FREE:
                    self._stay_open()
                    return False
                self._set_doors(Doors.CLOSING)
        elif self.doors is Doors.CLOSING:
            self._set_doors(Doors.CLOSED)
        else:
            stop = self._next_stop()
            if stop is None:
                return False
            if stop == self.floor:
                self._set_doors(Doors.OPENING)
            else:
                self._target, self._since = stop, self.now
        return True

    def _set_doors(self, doors: Doors) -> None:
        self.doors, self._since, self._blocked_since = doors, self.now, math.inf

    def _stay_open(self) -> None:
        """Something keeps the doors from closing: after BLOCKED_S those on this floor may board, as at an arrival."""
        self._blocked_since = min(self._blocked_since, self.now)
        if self.now >= self._blocked_since + BLOCKED_S:
            self._set_doors(Doors.OPEN)
            self._start_alighting_and_boarding(is_held_open=True)

    def _moving_through_doors(self) -> list[RideSession]:
        return [s for s in self.sessions.values() if s.phase in (RidePhase.BOARDING, RidePhase.ALIGHTING)]

    def _start_alighting_and_boarding(self, is_held_open: bool = False) -> bool:
        """Start alighting, and boarding once all have alighted; return whether the doors have to stay open.
        is_held_open: whether they could not close, so that calls on other floors wait."""
        for session in self.sessions.values():
            if session.phase is RidePhase.RIDING and session.destination == self.floor:
                session.enter_phase(RidePhase.ALIGHTING, self.now)
        is_any_alighting = any(s.phase is RidePhase.ALIGHTING for s in self.sessions.values())
        if not is_any_alighting and self.now < self._since + OPEN_LIMIT_S:
            for session in self._next_to_board(is_held_open):
                if session.party and not self._riders_after_stop():
                    self._party_since, self._party_limit_s = self.now, session.limit_s
                session.enter_phase(RidePhase.BOARDING, self._party_since if session.party else self.now)
                self.boarding.append(session)
        has_to_stay_open = bool(self._moving_through_doors()) or self._is_waiting_for_party()
        if has_to_stay_open:
            self._blocked_since = math.inf
        return has_to_stay_open

    def _next_to_board(self, is_held_open: bool) -> list[RideSession]:
        """Sessions that wait on this floor, suit the cabin's trip and fit in, oldest call first; only those of parties
        while an object obstructs the doors."""
        waiting = [s for s in self.sessions.values() if s.phase is RidePhase.WAITING and s.origin == self.floor]
        if waiting and self.doorway() is Doorway.OBSTRUCTED:
            waiting = [session for session in waiting if session.party]
        riders = self._riders_after_stop()
        leading = self._leading(waiting if is_held_open else self.sessions.values())
        chosen: list[RideSession] = []
        for session in waiting:
            suits_trip = leading is None or session is leading or self._lies_within(session, leading)
            if suits_trip and self._has_room(session, riders):
                riders.append(session)
                chosen.append(session)
        return chosen

    def _riders_after_stop(self) -> list[RideSession]:
        """Sessions of the robots that ride on: inside or boarding, without those that alight."""
        return [s for s in self.sessions.values() if s.phase in (RidePhase.BOARDING, RidePhase.RIDING)]

    def _has_room(self, session: RideSession, riders: list[RideSession]) -> bool:
        """Whether a robot fits in with these sessions; a party rides without others."""
        if any(other.party != session.party for other in riders):
            return False
        return fits(self.elevator, [session.radius_m, *(other.radius_m for other in riders)])

    # ---- parties ----

    def _party(self, name: str) -> list[RideSession]:
        return [s for s in self.sessions.values() if s.party == name]

    def _waits_for_party_members(self, session: RideSession) -> bool:
        """Whether a robot is inside at the floor where its party boards while other members are not."""
        is_in_here = session.phase is RidePhase.RIDING and session.origin == self.floor
        return is_in_here and bool(session.party) and not self._is_complete(self._party(session.party))

    @staticmethod
    def _is_complete(party: list[RideSession]) -> bool:
        """Whether all members of a party are inside."""
        return sum(s.phase in _INSIDE for s in party) >= party[0].size

    def _is_party_in_time(self) -> bool:
        """Whether the boarding limit of a party has not expired and the doors are open or opening."""
        return self.doors in (Doors.OPENING, Doors.OPEN) and self.now < self._party_since + self._party_limit_s

    def _is_waiting_for_party(self) -> bool:
        """Whether the doors stay open for members of a party that are still outside."""
        return self._is_party_in_time() and any(map(self._waits_for_party_members, self.sessions.values()))

    def _leading(self, calls: Collection[RideSession]) -> RideSession | None:
        """The session that determines the next stop: the oldest call of robots at the cabin, else of `calls`."""
        at_cabin = [s for s in self.sessions.values() if s.phase is not RidePhase.WAITING]
        return min(at_cabin or calls, key=lambda s: s.called_at, default=None)

    def _lies_within(self, session: RideSession, leading: RideSession) -> bool:
        """Whether a ride from this floor lies within the rest of the leading one, in its direction."""
        if leading.phase is RidePhase.WAITING and leading.origin != self.floor:
            return False
        here = self.heights[self.floor]
        rest, trip = self.heights[leading.destination] - here, self.heights[session.destination] - here
        return trip * rest > 0 and abs(trip) <= abs(rest) + _TOLERANCE_M

    def _next_stop(self) -> str | None:
        """Next floor to stop at; the current floor if a robot boards here; None without sessions."""
        leading = self._leading(self.sessions.values())
        if leading is None:
            return None
        goal = leading.origin if leading.phase is RidePhase.WAITING else leading.destination
        if goal == self.floor:
            return goal
        here = self.heights[self.floor]
        trip = self.heights[goal] - here

        def is_between(floor: str) -> bool:
            """Whether a floor lies between the cabin and its goal."""
            way = self.heights[floor] - here
            return way * trip >= 0 and abs(way) <= abs(trip) + _TOLERANCE_M

        stops = {s.destination for s in self.sessions.values() if s.phase is RidePhase.RIDING} | {goal}
        if leading.phase is not RidePhase.WAITING:
            riders = self._riders_after_stop()
            stops |= {
                s.origin
                for s in self.sessions.values()
                if s.phase is RidePhase.WAITING
                and self._has_room(s, riders)
                and (self.heights[s.destination] - self.heights[s.origin]) * trip > 0
                and is_between(s.destination)
            }
        between = [floor for floor in stops if floor != self.floor and is_between(floor)]
        return min(between, key=lambda floor: abs(self.heights[floor] - here))


def fits(elevator: Elevator, radii_m: list[float]) -> bool:
    """Whether robots of these radii fit into the cabin, each in a square as wide as the widest of them."""
    width = 2 * max(radii_m)
    columns, rows = (math.floor(side / width + _TOLERANCE_M) for side in elevator.size)
    return len(radii_m) <= columns * rows
